"""safetensors files whose header lies, and the arguments of a run."""

import json
import math
import struct

from cases import cases
from pieces import pickle
from programs import SYSTEM

LAYERS = {"action_net.weight": [2, 3], "action_net.bias": [2], "log_std": [2]}
DOCUMENT = {
    "schema": 1,
    "family": "PpoMlp",
    "sizes": None,
    "scalars": {"activation": "Tanh"},
    "aliases": {},
    "vocabulary": None,
    "normaliser": {"statistics": "per_component", "epsilon": 1e-8, "clip": 10.0, "enabled": True},
    "provenance": None,
}


def safetensors(header, data, length=None):
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + data


def file(document=None, layers=None, header=None, statistics=None, **changes):
    """A small policy. `document` changes the words about it, `header` the places of its arrays."""
    arrays = {name: ("F32", shape, [0.5] * math.prod(shape)) for name, shape in {**LAYERS, **(layers or {})}.items()}
    moments = {"mean": [0.0] * 3, "variance": [1.0] * 3, **(statistics or {})}
    arrays |= {f"observation_normaliser.{name}": ("F64", [len(row)], row) for name, row in moments.items()}
    places, data = {}, b""
    for name, (kind, shape, numbers) in {**arrays, **changes.get("arrays", {})}.items():
        packed = struct.pack(f"<{len(numbers)}{'f' if kind == 'F32' else 'd'}", *numbers)
        places[name] = {"dtype": kind, "shape": shape, "data_offsets": [len(data), len(data) + len(packed)]}
        data += packed
    for name, change in (header or {}).items():
        places[name] = {**places.get(name, {}), **change}
    words = {"arnold_analyze": json.dumps({**DOCUMENT, **(document or {})})}
    return safetensors({"__metadata__": words, **places}, data)


GOOD = file()


def lies():
    weight = "action_net.weight"
    broken = "Safetensors"
    infinite, undefined = float("inf"), float("nan")
    statistic = "ImpossibleStatistic"
    rows = [
        ("a header longer than the file", safetensors({}, b"", length=1_000_000), broken, "damaged"),
        ("a header of ninety megabytes that is not there", safetensors({}, b"", length=90_000_000), "Limit", "header"),
        ("no header", safetensors(b"{", b""), broken, "damaged"),
        ("a header that is a list", safetensors(b"{]", b""), broken, "damaged"),
        ("an array beyond the end", file(header={weight: {"data_offsets": [0, 2**40]}}), broken, "damaged"),
        ("an array that ends before it begins", file(header={weight: {"data_offsets": [24, 0]}}), broken, "damaged"),
        ("two arrays in one place", file(header={weight: {"data_offsets": [24, 48]}}), broken, "damaged"),
        ("a shape that overflows", file(header={weight: {"shape": [2**63, 2**63]}}), broken, "damaged"),
        ("a shape that does not fit its bytes", file(header={weight: {"shape": [2, 4]}}), broken, "damaged"),
        ("bytes that belong to no array", GOOD + bytes(8), broken, "damaged"),
        ("half-precision weights", file(header={weight: {"dtype": "F16", "shape": [4, 3]}}), broken, "F16"),
        ("a pickle behind the length", safetensors(b"{" + pickle(SYSTEM), b""), broken, "damaged"),
        ("a NaN in a weight", file(arrays={weight: ("F32", [2, 3], [undefined] * 6)}), "Tensor/NotFinite", weight),
        ("a name that would rewrite the terminal", file(layers={"\x1b[2J": [1]}), broken, "tensor"),
        ("a misplaced array with a name that would rewrite the terminal",
            file(header={"\x1b[2J": {"dtype": "F32", "shape": [9], "data_offsets": [0, 36]}}), broken, "damaged"),
        ("a field with a name that would rewrite the terminal", file(document={"\x1b[2J": 1}), broken, "arnold_analyze"),
        ("a document of another schema", file(document={"schema": 2}), broken, "schema 2"),
        ("a document of an unknown family", file(document={"family": "Shell"}), broken, "arnold_analyze"),
        ("a document with an unknown field", file(document={"run": "id"}), broken, "run"),
        ("a document nested without end", safetensors({"__metadata__": {"arnold_analyze": "[" * 100_000}}, b""), broken, "arnold_analyze"),
        ("an alias of nothing", file(document={"aliases": {"a": "nobody"}}), broken, "nobody"),
        ("an alias in the place of a tensor", file(document={"aliases": {weight: "log_std"}}), broken, weight),
        ("a negative variance", file(statistics={"variance": [1.0, -1.0, 1.0]}), statistic, "variance", "-1"),
        ("a NaN mean", file(statistics={"mean": [undefined] * 3}), statistic, "mean"),
        ("an infinite mean", file(statistics={"mean": [0.0, 0.0, infinite]}), statistic, "index 2"),
        ("fewer variances than means", file(statistics={"variance": [1.0]}), "StatisticLength", "variance"),
        ("an epsilon of zero", file(document={"normaliser": {**DOCUMENT["normaliser"], "epsilon": 0}}), statistic, "epsilon"),
        ("a negative clipping bound", file(document={"normaliser": {**DOCUMENT["normaliser"], "clip": -1}}), statistic, "clip"),
        ("no means", file(header={"observation_normaliser.mean": {"dtype": "I64"}}), broken, "mean"),
        ("a hundred megabytes of aliases",
            file(document={"aliases": {f"a{k}": weight for k in range(300_000)}}), "Limit", "header"),
        ("a million small values in the provenance", file(document={"provenance": [0] * 2_000_000}), "Limit", "header"),
    ]
    return cases("safetensors", rows)


def arguments():
    rows = [
        ("arguments that are no JSON", pickle(SYSTEM), "Settings", "args.json"),
        ("arguments nested without end", b"[" * 100_000, "Settings", "recursion"),
        ("arguments cut short", b'{"num_heads": 2', "Settings", "args.json"),
        ("a number beyond any number", b'{"num_heads": 1e999}', "Settings", "range"),
    ]
    ignored = [
        ("sizes that are texts, negative or fractions", b'{"num_heads": "2", "num_layers": -1, "mask_rate": "x", "tasks": [1, null]}'),
        ("arguments that are a list", b"[1, 2]"),
    ]
    return cases("arguments", rows) + cases("arguments", [(attack, content, None) for attack, content in ignored])
