"""Makes the synthetic cohort in `data/emg/synthetic`: nine invented people with the timing of published ones.

    python3 scripts/synthetic_emg.py [FOLDER]

Each channel is a constant plus Gaussian bursts. Where the bursts lie in the gait cycle, how wide and how high they are,
was read off the mean profiles of nine people walking at 4.5 km/h (Wang, Basu, Durandau & Sartori 2023, Wearable
Technologies 4:e11; data: https://zenodo.org/records/7422031, CC BY 4.0) and rounded to whole percent of the cycle and
0.05 of the maximum. Every invented person shifts, widens and scales the bursts a little, at random with a fixed seed. No
recorded sample is in the result, and nothing about real people can be concluded from it.

Needs Python alone. Values are rounded to six decimals, so every machine writes the same bytes.
"""

import math
import pathlib
import random
import struct
import sys

POINTS = 100
SUBJECTS = range(4, 13)
SEED = 2023

# Label: constant, then bursts of (centre, standard deviation) in percent of the cycle and height.
CHANNELS = {
    "Soleus": (0.10, [(39, 5, 0.85), (20, 12, 0.30)]),
    "Medial Gastrocnemius": (0.10, [(40, 5, 0.85), (24, 8, 0.35)]),
    "Lateral Gastrocnemius": (0.10, [(40, 5, 0.85), (8, 8, 0.15)]),
    "Tibialis Anterior": (0.20, [(99, 5, 0.75), (66, 6, 0.20)]),
    "Semimembranosus": (0.08, [(90, 5, 0.80), (8, 12, 0.25)]),
    "Biceps Femoris": (0.12, [(90, 5, 0.85), (1, 5, 0.20)]),
    "Vastus Lateral": (0.30, [(3, 6, 0.55), (54, 6, 0.10)]),
    "Rectus Femoris": (0.18, [(4, 5, 0.75), (58, 5, 0.20)]),
    "Vastus Medial": (0.15, [(4, 6, 0.85), (57, 5, 0.08)]),
}


def burst(point, centre, width, height):
    """A Gaussian on the cycle, whose end is its beginning."""
    distance = (point - centre + POINTS / 2) % POINTS - POINTS / 2
    return height * math.exp(-0.5 * (distance / width) ** 2)


def person(generator):
    """Rows of one table: the time, then nine envelopes."""
    columns = [[float(point + 1) for point in range(POINTS)]]
    late = generator.uniform(-1.5, 1.5)
    for constant, bursts in CHANNELS.values():
        gain = generator.uniform(0.25, 0.75)
        own = [
            (
                centre + late + generator.uniform(-1.5, 1.5),
                width * generator.uniform(0.85, 1.2),
                height * generator.uniform(0.8, 1.15),
            )
            for centre, width, height in bursts
        ]
        ripple = [(generator.uniform(0, 0.03), generator.uniform(0, 2 * math.pi)) for _ in range(4)]
        column = []
        for point in range(POINTS):
            value = constant + sum(burst(point, *one) for one in own)
            for order, (size, phase) in enumerate(ripple, start=1):
                value += size * math.sin(2 * math.pi * order * point / POINTS + phase)
            column.append(round(gain * max(value, 0.0), 6))
        columns.append(column)
    return [[column[point] for column in columns] for point in range(POINTS)]


def npy(descr, shape, content):
    """An array file, version 1.0."""
    header = f"{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}"
    header = header.ljust(-(-(len(header) + 11) // 64) * 64 - 11) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode("ascii") + content


def main():
    here = pathlib.Path(__file__).resolve().parent
    default = here.parent / "data" / "emg" / "synthetic"
    folder = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else default
    folder.mkdir(parents=True, exist_ok=True)
    labels = ["Time", *CHANNELS]
    width = max(len(label) for label in labels)
    text = "".join(label.ljust(width, "\0") for label in labels).encode("utf-32-le")
    (folder / "EMG_labels.npy").write_bytes(npy(f"<U{width}", f"({len(labels)},)", text))
    generator = random.Random(SEED)
    for subject in SUBJECTS:
        rows = person(generator)
        values = [value for row in rows for value in row]
        content = struct.pack(f"<{len(values)}d", *values)
        name = f"EMG_subject_{subject:02d}_walk_45_avg.npy"
        (folder / name).write_bytes(npy("<f8", f"({POINTS}, {len(labels)})", content))
    (folder / "SYNTHETIC").write_text(
        "These nine people are invented (scripts/synthetic_emg.py). Numbers made with them say nothing about humans.\n"
    )


if __name__ == "__main__":
    main()
