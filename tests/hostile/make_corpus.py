#!/usr/bin/env python3
"""Makes the hostile files that the readers of this project must refuse. Needs Python 3.10 and its standard library.

    make_corpus.py write FOLDER    the files, and index.json: what each attacks, who reads it, what must be said about it
    make_corpus.py check           opens the live ones with Python's own pickle and proves that each runs its payload
    make_corpus.py seeds FOLDER    small files as a start for the fuzz targets, one folder per target

Every file is a small good one with one thing wrong, so that an error can only come from that thing. The payloads make an
empty file called EXECUTED in the current folder, nothing else. Two runs of one Python write the same bytes.
"""

import base64
import io
import json
import os
import pickle
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import arrays
import headers
import moments
import pickles
import pieces
import programs
import tensors
import zips
from cases import MARKER, Case

EXTENSIONS = {
    "policy": "zip",
    "normaliser": "pkl",
    "scaler": "pkl",
    "safetensors": "safetensors",
    "npy": "npy",
    "npz": "npz",
    "vocabulary": "json",
    "arguments": "json",
}


def good():
    """What the hostile files differ from. These must be read."""
    transposed = pieces.tensor(pieces.storage("torch.FloatStorage", "0", 6), 0, [3, 2], [1, 3])
    column_by_column = pieces.policy(
        pieces.torch_file(pieces.state(action_net__weight=transposed), {"0": pieces.floats(*range(6))})
    )
    return [
        Case("nothing: a policy", "policy", pieces.policy(), None),
        Case("nothing: a policy stored column by column", "policy", column_by_column, None),
        Case("nothing: an NPG policy", "policy", pieces.gradient_policy(), None),
        Case("nothing: a bare torch file", "policy", pieces.GOOD_WEIGHTS, None),
        Case("nothing: a normaliser by component", "normaliser", pieces.component_normaliser(), None),
        Case("nothing: a normaliser by signature", "normaliser", pieces.signature_normaliser(*pieces.GOOD_SIGNATURES), None),
        Case("nothing: a scaler", "scaler", moments.scaler(), None),
        Case("nothing: a converted policy", "safetensors", headers.GOOD, None),
        Case("nothing: arguments of a run", "arguments", b'{"num_heads": 2, "tasks": ["pen"]}', None),
        Case("nothing: an array", "npy", arrays.GOOD, None),
        Case("nothing: an archive of arrays", "npz", arrays.archive({"a.npy": arrays.GOOD}), None),
        Case("nothing: a vocabulary", "vocabulary", b'{"padding": 0, "hip": 1}', None),
    ]


def all_cases():
    groups = {
        "good": good(),
        "program": programs.live(),
        "forbidden": programs.forbidden(),
        "growing": pickles.growing(),
        "malformed": pickles.malformed(),
        "array": moments.arrays(),
        "statistic": moments.statistics(),
        "scaler": moments.scalers(),
        "view": tensors.views(),
        "storage": tensors.storages(),
        "stream": tensors.streams(),
        "member": zips.members(),
        "end": zips.ends(),
        "bomb": zips.bombs(),
        "content": zips.contents(),
        "npy": arrays.single(),
        "npz": arrays.archives(),
        "vocabulary": arrays.vocabularies(),
        "header": headers.lies(),
        "arguments": headers.arguments(),
    }
    for group, found in groups.items():
        for number, case in enumerate(found, start=1):
            # Policies come as archives and as pickles; the extension says nothing to the readers.
            yield f"{group}-{number:02}.{EXTENSIONS[case.reader]}", case


def write(folder):
    index = []
    for name, case in all_cases():
        (folder / name).write_bytes(case.content)
        index.append(
            {
                "file": name,
                "attacks": case.attack,
                "reader": case.reader,
                "error": case.error,
                "says": [part for part in case.says if part],
                "live": case.live,
            }
        )
    (folder / "index.json").write_text(json.dumps(index, indent=1, ensure_ascii=True))


class HasAnything(type):
    def __getattr__(cls, name):
        if name.startswith("__"):
            raise AttributeError(name)
        return cls


class Anything(metaclass=HasAnything):
    """Stands for any class or function that is not installed here."""

    def __new__(cls, *_arguments, **_names):
        return object.__new__(cls)

    def __call__(self, *_arguments, **_names):
        return self

    def __setitem__(self, key, value):
        pass

    def __setstate__(self, state):
        pass


class Victim(pickle.Unpickler):
    """Python's own unpickler, with a stand-in for what is not installed: what torch and NumPy would do, less the arrays."""

    def find_class(self, module, name):
        if module == "torch.storage" and name == "_load_from_bytes":
            return lambda content: Victim(io.BytesIO(content)).load()
        try:
            return super().find_class(module, name)
        except (ImportError, AttributeError):
            return Anything

    def persistent_load(self, _reference):
        return None


def open_as_python_would(content):
    """Reads every pickle of a file: the file itself, the members of archives in it, and what settings hold in base64."""
    if not zipfile.is_zipfile(io.BytesIO(content)):
        Victim(io.BytesIO(content)).load()
        return
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for member in archive.namelist():
            inside = archive.read(member)
            if member == "data":
                open_settings(json.loads(inside))
            elif member.endswith((".pth", "data.pkl")):
                open_as_python_would(inside)


def open_settings(value):
    if isinstance(value, dict):
        if ":serialized:" in value:
            Victim(io.BytesIO(base64.b64decode(value[":serialized:"]))).load()
        for inner in value.values():
            open_settings(inner)


def check():
    """Opens each live file in a process and a folder of its own; says which of them did nothing."""
    dead = []
    live = [(name, case) for name, case in all_cases() if case.live]
    for name, case in live:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, name)
            file.write_bytes(case.content)
            victim = [sys.executable, "-B", os.path.abspath(__file__), "victim", name]
            ended = subprocess.run(victim, cwd=folder, capture_output=True, timeout=60)
            if not Path(folder, MARKER).exists():
                dead.append(f"{name} ({case.attack}): {ended.stderr.decode()[-300:]}")
    print(f"{len(live) - len(dead)} of {len(live)} payloads are live")
    if dead:
        sys.exit("\n".join(dead))


def state_program(content):
    """The pickle of a policy's state dictionary, or nothing where the archive is not made for reading."""
    if len(content) > 100_000:
        return b""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            with zipfile.ZipFile(io.BytesIO(archive.read("policy.pth"))) as weights:
                return weights.read("archive/data.pkl")
    except Exception:  # Python's reader fails on these files in every way there is.
        return b""


def seeds(folder):
    """Small files by fuzz target. What Python would read as a pickle goes without its protocol to the pickle machine."""
    largest = 20_000
    counts = {}
    for name, case in all_cases():
        content = case.content
        found = []
        if content[:1] == b"\x80":
            found = [("pickle", content[2:]), ("normaliser", content)]
        elif case.reader == "policy":
            found = [("archive", content)]
            found.append(("torch", state_program(content)))
        elif case.reader in ("npy", "npz"):
            found = [("numpy", content)]
        elif case.reader == "safetensors":
            found = [("safetensors", content)]
        elif case.reader in ("vocabulary", "arguments"):
            found = [("json", content)]
        for target, seed in found:
            if len(seed) > largest:
                continue
            (folder / target).mkdir(exist_ok=True)
            (folder / target / name).write_bytes(seed)
            counts[target] = counts.get(target, 0) + 1
    print("seeds:", ", ".join(f"{target} {count}" for target, count in sorted(counts.items())))


def main(words):
    match words:
        case ["write", folder]:
            write(Path(folder))
        case ["check"]:
            check()
        case ["seeds", folder]:
            seeds(Path(folder))
        case ["victim", file]:
            open_as_python_would(Path(file).read_bytes())
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
