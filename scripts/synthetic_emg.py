"""Makes the synthetic cohort in `data/emg/synthetic`, nine invented people with the timing of published ones, and an
invented cycle of the fourteen muscles of `factors`.

    python3 scripts/synthetic_emg.py [FOLDER]

Each channel is a constant plus Gaussian bursts. Where the bursts lie in the gait cycle, how wide and how high they are,
was read off the mean profiles of nine people walking at 4.5 km/h (Wang, Basu, Durandau & Sartori 2023, Wearable
Technologies 4:e11; data: https://zenodo.org/records/7422031, CC BY 4.0) and rounded to whole percent of the cycle and
0.05 of the maximum. Every invented person shifts, widens and scales the bursts a little, at random with a fixed seed. No
recorded sample is in the result, and nothing about real people can be concluded from it.

`invented_simulation.npz` holds an averaged gait cycle of the fourteen muscles in which `factors` looks for factors. It is
made of five bursts, because five factors were found in people (Ivanenko, Poppele & Lacquaniti 2004, The Journal of
Physiology 556:267): at the landing of the foot, in stance, at push-off, when the leg begins to swing and when it ends. Their
places and the share that each muscle has of each are invented.

Needs Python alone. Values are rounded to six decimals, so every machine writes the same bytes.
"""

import io
import math
import pathlib
import random
import struct
import sys
import zipfile

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

# Five bursts (centre and standard deviation in percent of the cycle), and each muscle's constant and share of the bursts.
FACTOR_POINTS = 200
FACTOR_BURSTS = [(5, 5), (20, 6), (42, 5), (64, 6), (92, 5)]
FACTOR_MUSCLES = {
    "TA": (0.10, [0.30, 0.00, 0.00, 0.45, 0.35]),
    "LG": (0.06, [0.00, 0.20, 0.75, 0.00, 0.00]),
    "PERL": (0.08, [0.10, 0.30, 0.55, 0.05, 0.00]),
    "VL": (0.06, [0.70, 0.20, 0.00, 0.00, 0.20]),
    "RF": (0.07, [0.45, 0.10, 0.00, 0.40, 0.10]),
    "SART": (0.05, [0.00, 0.05, 0.00, 0.60, 0.10]),
    "BF": (0.06, [0.20, 0.00, 0.05, 0.00, 0.75]),
    "ST": (0.05, [0.15, 0.00, 0.00, 0.10, 0.80]),
    "TFL": (0.07, [0.30, 0.35, 0.00, 0.30, 0.00]),
    "ADD": (0.06, [0.10, 0.00, 0.10, 0.50, 0.30]),
    "GM": (0.05, [0.60, 0.15, 0.00, 0.00, 0.25]),
    "Sol": (0.08, [0.05, 0.45, 0.65, 0.00, 0.00]),
    "MG": (0.06, [0.00, 0.35, 0.75, 0.00, 0.00]),
    "Gmed": (0.07, [0.50, 0.55, 0.05, 0.00, 0.05]),
}


def burst(percent, centre, width, height):
    """A Gaussian on the cycle, whose end is its beginning."""
    distance = (percent - centre + 50) % 100 - 50
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
            value = constant + sum(burst(100 * point / POINTS, *one) for one in own)
            for order, (size, phase) in enumerate(ripple, start=1):
                value += size * math.sin(2 * math.pi * order * point / POINTS + phase)
            column.append(round(gain * max(value, 0.0), 6))
        columns.append(column)
    return [[column[point] for column in columns] for point in range(POINTS)]


def cycle(generator):
    """One row per muscle: its activity over the cycle."""
    rows = []
    for constant, shares in FACTOR_MUSCLES.values():
        ripple = [(generator.uniform(0, 0.02), generator.uniform(0, 2 * math.pi)) for _ in range(4)]
        row = []
        for point in range(FACTOR_POINTS):
            percent = 100 * point / FACTOR_POINTS
            bursts = zip(FACTOR_BURSTS, shares)
            value = constant + sum(burst(percent, *where, share) for where, share in bursts)
            for order, (size, phase) in enumerate(ripple, start=1):
                value += size * math.sin(2 * math.pi * order * percent / 100 + phase)
            row.append(round(max(value, 0.0), 6))
        rows.append(row)
    return rows


def texts(labels):
    """An array file of texts."""
    width = max(len(label) for label in labels)
    content = "".join(label.ljust(width, "\0") for label in labels).encode("utf-32-le")
    return npy(f"<U{width}", f"({len(labels)},)", content)


def numbers(rows):
    """An array file of rows of numbers."""
    values = [value for row in rows for value in row]
    return npy("<f8", f"({len(rows)}, {len(rows[0])})", struct.pack(f"<{len(values)}d", *values))


def npz(members):
    """An archive of array files, stored as they are, of no date."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, member in sorted(members.items()):
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), member)
    return content.getvalue()


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
    (folder / "EMG_labels.npy").write_bytes(texts(labels))
    generator = random.Random(SEED)
    for subject in SUBJECTS:
        rows = person(generator)
        (folder / f"EMG_subject_{subject:02d}_walk_45_avg.npy").write_bytes(numbers(rows))
    invented = {
        "emg_muscles": texts(list(CHANNELS)),
        "factor_muscles": texts(list(FACTOR_MUSCLES)),
        "invented_right": numbers(cycle(generator)),
    }
    (folder / "invented_simulation.npz").write_bytes(npz(invented))
    (folder / "SYNTHETIC").write_text(
        "These nine people are invented (scripts/synthetic_emg.py). Numbers made with them say nothing about humans.\n"
    )


if __name__ == "__main__":
    main()
