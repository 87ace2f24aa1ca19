"""Makes `tests/fixtures/walking/stumbling_expert.safetensors`: a walking expert of invented weights that falls.

    python3 scripts/make_stumbling_expert.py

One of 130 draws like this one, each of which played ten episodes: here one of the steps before the fall goes forward, so
that there is a gait cycle to average. Needs Python alone; every machine writes the same bytes.
"""

import json
import pathlib
import random
import struct

OBSERVATIONS = 309
HIDDEN = 16
MUSCLES = 80


def main():
    generator = random.Random(107)

    def uniform(count, low, high):
        return struct.pack(f"<{count}f", *(generator.uniform(low, high) for _ in range(count)))

    arrays = [
        ("norm.n", [1], struct.pack("<f", 1000.0)),
        ("norm.mean", [OBSERVATIONS], uniform(OBSERVATIONS, -0.1, 0.1)),
        ("norm.std", [OBSERVATIONS], uniform(OBSERVATIONS, 0.5, 2.0)),
        ("net.affine_layers.0.weight", [HIDDEN, OBSERVATIONS], uniform(HIDDEN * OBSERVATIONS, -0.1, 0.1)),
        ("net.affine_layers.0.bias", [HIDDEN], uniform(HIDDEN, -0.1, 0.1)),
        ("action_mean.weight", [MUSCLES, HIDDEN], uniform(MUSCLES * HIDDEN, -0.2, 0.2)),
        ("action_mean.bias", [MUSCLES], uniform(MUSCLES, -0.17561531415042952, 1.8446658957021758)),
    ]
    header, content = {}, b""
    for name, shape, values in arrays:
        end = len(content) + len(values)
        header[name] = {"dtype": "F32", "shape": shape, "data_offsets": [len(content), end]}
        content += values
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    root = pathlib.Path(__file__).resolve().parent.parent
    path = root / "tests" / "fixtures" / "walking" / "stumbling_expert.safetensors"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(struct.pack("<Q", len(text)) + text + content)


if __name__ == "__main__":
    main()
