"""Runs every notebook from its first cell to its last, and fails with the cell that fails.

    python3 scripts/run_notebooks.py [FOLDER]

Needs nbclient, ipykernel, polars and matplotlib; exits with 3 where one of them is missing. Writes nothing.
"""

import sys
from pathlib import Path

try:
    import ipykernel  # noqa: F401
    import matplotlib  # noqa: F401
    import nbformat
    import polars  # noqa: F401
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError
except ImportError as missing:
    print(missing, file=sys.stderr)
    sys.exit(3)

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "notebooks")
for path in sorted(folder.glob("*.ipynb")):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    try:
        NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()
    except CellExecutionError as error:
        sys.exit(f"{path}: {error}")
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    pictures = sum("image/png" in output.get("data", {}) for output in outputs)
    if pictures == 0:
        sys.exit(f"{path}: it drew nothing")
    print(f"{path.name}: {pictures} drawn")
