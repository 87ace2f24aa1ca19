"""The subspace analyses as one would write them with NumPy and scikit-learn, timed on one core.

Called by `cargo bench --bench analysis` with a JSON object of sizes; prints one JSON object of seconds.
"""

import os

for library in ("OPENBLAS", "MKL", "OMP", "BLIS"):
    os.environ[f"{library}_NUM_THREADS"] = "1"

import json
import sys
import time
import warnings

import numpy as np
from sklearn.decomposition import NMF

warnings.filterwarnings("ignore", message="Maximum number of iterations")
sizes = json.loads(sys.argv[1])
muscles = sizes["muscles"]


def controls(rows):
    t = np.arange(rows)[:, None]
    m = np.arange(muscles)[None, :]
    return 0.5 + 0.25 * np.sin(0.013 * t * (1 + m % 7) + m) + 0.25 * np.sin(0.0071 * t * (1 + m))


def fastest(work, repeats):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def factorise(rank):
    NMF(rank, init="nndsvda", solver="cd", tol=0, max_iter=sizes["iterations"]).fit_transform(x)


def compare(a, b):
    (sigma, va, variances), (_, vb, _) = a, b
    own = np.cumsum(variances)
    caught = np.cumsum(np.einsum("ij,jk,ik->i", vb, sigma, vb, optimize=True))
    pad = [
        np.degrees(np.arccos(np.clip(np.linalg.svd(va[:n] @ vb[:n].T, compute_uv=False), 0, 1))).mean()
        for n in range(1, muscles + 1)
    ]
    return 1 - caught / own, pad


def cell(index):
    generator = np.random.default_rng(index)
    rows = generator.standard_normal((500, muscles)) * np.linspace(1, 0.05, muscles)
    rows = rows @ np.linalg.qr(generator.standard_normal((muscles, muscles)))[0]
    sigma = np.cov(rows, rowvar=False)
    values, vectors = np.linalg.eigh(sigma)
    return sigma, vectors[:, ::-1].T.copy(), values[::-1]


x = controls(sizes["rows"])
seconds = {f"rank {rank}": fastest(lambda: factorise(rank), sizes["repeats"]) for rank in sizes["ranks"]}
cells = [cell(index) for index in range(sizes["cells"])]


def all_pairs():
    for i, a in enumerate(cells):
        for b in cells[i + 1 :]:
            compare(a, b)


seconds["pairs"] = fastest(all_pairs, sizes["repeats"])
print(json.dumps(seconds))
