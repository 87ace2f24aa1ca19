"""Normalisers whose arrays lie, or whose numbers no training produces."""

import math

from cases import cases
from pieces import *  # noqa: F403

ONES_OF_THREE = array([3], [1.0] * 3)


def arrays():
    f8 = dtype("f8")
    rows = [
        ("big-endian numbers", [integer(3)], dtype("f8", ">"), byte_string(bytes(24)), "Tensor/BigEndian"),
        ("big-endian in the type's name", [integer(3)], dtype(">f8", "|"), byte_string(bytes(24)), "Tensor/BigEndian"),
        ("an array of objects", [integer(3)], dtype("O8", "|"), items(NONE, NONE, NONE), "Tensor/Malformed"),
        ("an array of objects in bytes", [integer(3)], dtype("O8", "|"), byte_string(bytes(24)),
            "Tensor/UnknownElementType", "O8"),
        ("an array of a type that would rewrite the terminal", [integer(3)], dtype("\x1b[2J"), byte_string(bytes(24)),
            "Tensor/UnknownElementType"),
        ("an array of a type of a megabyte", [integer(3)], dtype("f" * (1 << 20)), byte_string(bytes(24)),
            "Tensor/UnknownElementType"),
        ("an array of complex numbers", [integer(3)], dtype("c16"), byte_string(bytes(48)), "Tensor/UnknownElementType"),
        ("an array of an unknown order", [integer(3)], dtype("f8", "?"), byte_string(bytes(24)), "Tensor/Malformed"),
        ("an array without a type", [integer(3)], NONE, byte_string(bytes(24)), "Tensor/Malformed"),
        ("a negative size", [integer(-3)], f8, byte_string(bytes(24)), "Tensor/Malformed"),
        ("a size that is a text", [text("3")], f8, byte_string(bytes(24)), "Tensor/Malformed"),
        ("a size of three and a half", [number(3.5)], f8, byte_string(bytes(24)), "Tensor/Malformed"),
        ("more elements than bytes", [integer(2**60)], f8, byte_string(bytes(24)), "Tensor"),
        ("fewer elements than bytes", [integer(2)], f8, byte_string(bytes(24)), "Tensor/WrongLength", "16", "24"),
        ("a size that overflows", [integer(2**63 - 1)] * 2, f8, byte_string(bytes(24)), "Tensor/ImpossibleShape"),
        ("nothing, of a huge size", [integer(0), integer(2**63 - 1)], f8, byte_string(b""), "Tensor/WrongShape"),
        ("a matrix instead of a list", [integer(3), integer(1)], f8, byte_string(bytes(24)), "Tensor/WrongShape"),
        ("bytes that are a list", [integer(3)], f8, items(NONE), "Tensor/Malformed"),
        ("a hundred thousand axes", [integer(1)] * 100_000, f8, byte_string(bytes(8)), "Tensor/Malformed", "100000"),
    ]  # fmt: skip
    claims = [
        (attack, component_normaliser(mean=raw_array(shape, element, content)), error, "mean", *says)
        for attack, shape, element, content, error, *says in rows
    ]
    other = [
        ("a column order that is a number", raw_array([integer(3)], f8, byte_string(bytes(24)), integer(1))),
        ("a mean that is a list", items(number(0.0))),
        ("a mean that is None", NONE),
        ("an array without a state", call("numpy.core.multiarray._reconstruct")),
        ("an array from a buffer that is no buffer", call("numpy.core.numeric._frombuffer", NONE, f8, NONE, NONE)),
    ]
    return cases(
        "normaliser",
        claims + [(attack, component_normaliser(mean=mean), "Tensor/Malformed", "mean") for attack, mean in other],
    )


def statistics():
    def table(words, row=1):
        return signature_normaliser(PADDING, (words, row))

    good = component_normaliser()
    impossible = "ImpossibleStatistic"
    return cases(
        "normaliser",
        [
            ("a mean that is no number", component_normaliser(mean=array([3], [0.0, math.nan, 0.0])), impossible,
                "mean", "NaN", "index 1"),
            ("an infinite variance", component_normaliser(variance=array([3], [1.0, 1.0, math.inf])), impossible,
                "var", "inf", "index 2"),
            ("a negative variance", component_normaliser(variance=array([3], [-1e-9, 1.0, 1.0])), impossible, "index 0"),
            ("an epsilon of zero", component_normaliser(epsilon=0.0), impossible, "epsilon"),
            ("a negative epsilon", component_normaliser(epsilon=-1e-8), impossible, "epsilon"),
            ("a clip that is no number", component_normaliser(clip=math.nan), impossible, "clip_obs"),
            ("an infinite clip", component_normaliser(clip=math.inf), impossible, "clip_obs"),
            ("a mean and a variance of different lengths", component_normaliser(mean=array([2], [0.0] * 2)),
                "Tensor/WrongShape"),
            ("no statistics", good.replace(text("obs_rms"), text("obs_rmz")), "Record/Missing", "obs_rms"),
            ("a switch that is a number", good.replace(text("norm_obs") + b"\x88", text("norm_obs") + b"K\x01"),
                "Record", "norm_obs"),
            ("another object than the one it names first",
                pickle(sequence(name(VECNORMALIZE), NONE)), "Record"),
            ("a variance that is finite in eight bytes and infinite in four",
                signature_normaliser(*GOOD_SIGNATURES, variance=1e300), impossible, "variance", "index 5"),
            ("one row twice", table([integer(5)], 0), "Record", "row number"),
            ("a row beyond the last", table([integer(5)], 2), "Record"),
            ("a row before the first", table([integer(5)], -1), "Record"),
            ("a word beyond all vocabularies", table([integer(70_000)]), "Record", "sig_ids_dict"),
            ("a negative word", table([integer(-1)]), "Record"),
            ("half a word", table([number(1.5)]), "Record"),
            ("a word that is no number", table([number(math.nan)]), "Record"),
            ("words that are not sorted", table([integer(9), integer(5)]), "Record"),
            ("a signature without words", table([]), "Record"),
            ("a table with too many rows",
                signature_normaliser(*[([integer(word)], word) for word in range(300)]), "Record"),
        ],
    )  # fmt: skip


def scaler(mean=None, scale=None, kind="StandardScaler"):
    """scikit-learn's scaler, of three components."""
    attributes = {"mean_": mean or array([3], [1, 1, 1]), "scale_": scale or array([3], [1, 1, 1])}
    return pickle(instance(f"sklearn.preprocessing._data.{kind}", **attributes))


def scalers():
    """Scalers of an ensemble's classifier."""
    no_scale = pickle(instance("sklearn.preprocessing._data.StandardScaler", mean_=array([3], [1, 1, 1])))
    return cases(
        "scaler",
        [
            ("a scale of zero", scaler(scale=array([3], [1, 0, 1])), "ImpossibleStatistic"),
            ("fewer scales than means", scaler(scale=array([2], [1, 1])), "Tensor/WrongShape"),
            ("a mean of two axes", scaler(mean=array([3, 1], [1, 1, 1])), "Tensor/WrongShape"),
            ("no scale", no_scale, "Record/Missing"),
            ("another scaler", scaler(kind="MinMaxScaler"), "Pickle/UnknownGlobal", "MinMaxScaler"),
        ],
    )
