"""SPARC, LDLJ and NVP of many episodes with NumPy and SciPy: the peer of `benches/analysis.rs`.

    python3 scripts/peers/smoothness.py EPISODES STEPS JOINTS [RUNS]

Makes the same joint angles as the benchmark, measures every episode, and prints one JSON object: the seconds of the
fastest run, and the mean of each metric over the episodes, by which the two are checked against each other. One
thread. Everything that can be one NumPy call over all joints of an episode is one; peaks are SciPy's `find_peaks`, joint
by joint, which takes one signal.
"""

import json
import os
import sys
import time

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import numpy as np  # noqa: E402
import scipy  # noqa: E402
from scipy.signal import find_peaks  # noqa: E402


def angles(episode, steps, joints):
    """Joint angles of an episode, steps x joints, rad."""
    t = np.arange(steps)[:, None]
    j = np.arange(joints)[None, :]
    slow = np.sin(0.05 * t * (1 + j % 5) + 0.1 * episode + j)
    return slow + 0.05 * np.sin(1.7 * t + j * (1 + episode % 7))


def sparc(q):
    """Spectral arc length of the joints' common speed, unit rate, threshold 0.05, pad level 4."""
    speed = np.linalg.norm(np.diff(q, axis=0), axis=1)
    length = 2 ** (int(np.ceil(np.log2(len(speed)))) + 4)
    magnitude = np.abs(np.fft.rfft(speed, length))
    magnitude /= magnitude.max()
    last = np.flatnonzero(magnitude >= 0.05)[-1]
    frequency = np.arange(last + 1) / length
    width = frequency[-1] - frequency[0] + 1e-12
    return -np.sum(np.sqrt((np.diff(frequency) / width) ** 2 + np.diff(magnitude[: last + 1]) ** 2))


def ldlj(q):
    """Log dimensionless jerk, mean over joints."""
    peak = np.abs(q - q.mean(axis=0)).max(axis=0)
    jerk = (np.diff(q, n=3, axis=0) ** 2).sum(axis=0)
    moves = (peak >= 1e-6) & (jerk >= 1e-12)
    return np.mean(-np.log((len(q) - 1.0) ** 5 * jerk[moves] / peak[moves] ** 2))


def nvp(q):
    """Number of velocity peaks, mean over joints."""
    speeds = np.abs(np.diff(q, axis=0)).T
    return np.mean([len(find_peaks(s, height=0.05 * s.max())[0]) for s in speeds if s.max() >= 1e-6])


def main():
    episodes, steps, joints = (int(word) for word in sys.argv[1:4])
    runs = int(sys.argv[4]) if len(sys.argv) > 4 else 3
    recorded = [np.ascontiguousarray(angles(episode, steps, joints)) for episode in range(episodes)]
    fastest = {name: float("inf") for name in ("sparc", "ldlj", "nvp")}
    means = {}
    for _ in range(runs):
        for metric in (sparc, ldlj, nvp):
            start = time.perf_counter()
            values = [metric(q) for q in recorded]
            seconds = time.perf_counter() - start
            fastest[metric.__name__] = min(fastest[metric.__name__], seconds)
            means[metric.__name__] = float(np.mean(values))
    versions = f"NumPy {np.__version__}, SciPy {scipy.__version__}"
    print(json.dumps({"versions": versions, "seconds": fastest, "means": means}))


if __name__ == "__main__":
    main()
