"""torch tensors that do not fit their storage."""

import math
import struct

from cases import cases
from pieces import *  # noqa: F403

FLOATS = "torch.FloatStorage"


def views():
    three = storage(FLOATS, "0", 3)
    rows = [
        ("one element too far", 1, [3], [1], "OutsideStorage", "element 3", "3"),
        ("an offset beyond the end", 2**62, [1], [1], "OutsideStorage"),
        ("an offset that overflows", 2**63 - 1, [3], [2**63 - 1], "ImpossibleShape"),
        ("a stride too long", 0, [2], [3], "OutsideStorage"),
        ("a stride that overflows", 0, [2, 1], [2**63 - 1, 1], "OutsideStorage"),
        ("a stride of zero over a huge shape", 0, [2**40], [0], "Overlapping"),
        ("more elements than the storage, one over the other", 0, [2, 2], [1, 1], "Overlapping"),
        ("a shape that overflows", 0, [2**63 - 1] * 2, [0, 0], "ImpossibleShape"),
        ("more axes than strides", 0, [3, 1], [1], "ImpossibleShape"),
        ("more strides than axes", 0, [3], [1, 1], "ImpossibleShape"),
        ("a hundred thousand axes", 0, [1] * 100_000, [1] * 100_000, "Malformed", "100000"),
        ("a negative size", 0, [-3], [1], "Malformed"),
        ("a negative stride", 2, [3], [-1], "Malformed"),
        ("a negative offset", -1, [3], [1], "Malformed"),
    ]
    return cases(
        "policy",
        [
            (attack, policy_with(tensor(three, offset, shape, strides)), f"Tensor/{error}", "action_net.weight", *says)
            for attack, offset, shape, strides, error, *says in rows
        ],
    )


def storages():
    def policy_of(weight, **contents):
        return policy(torch_file(state(action_net__weight=weight), {k.strip("_"): v for k, v in contents.items()}))

    two = {"action_net__a": vector("0", 3)}
    escape = "../../../etc/passwd"
    wide = state(**{f"action_net__{k}": vector("0", 1 << 20) for k in range(1_000)})
    turned = {f"action_net__{k}": tensor(storage(FLOATS, "0", 1 << 18), k, [2, 1], [3, 1]) for k in range(2_000)}
    return cases(
        "policy",
        [
            ("a storage longer than its member", policy_with(vector("0", 1_000_000)), "Tensor/WrongLength", "12"),
            ("a storage of 2^62 elements", policy_with(tensor(storage(FLOATS, "0", 2**62), 0, [1], [1])),
                "Tensor/WrongLength"),
            ("a storage of -1 elements", policy_with(tensor(storage(FLOATS, "0", -1), 0, [1], [1])), "Tensor/Malformed"),
            ("a storage that is not there", policy_with(vector("1", 3)), "Archive/MissingMember", "archive/data/1"),
            ("a storage outside the archive", policy_with(vector(escape, 3)), "Tensor/Malformed"),
            ("a storage without a tag", policy_with(tensor(sequence(text("x"), name(FLOATS), text("0"), text("cpu"),
                integer(3)) + b"Q", 0, [3], [1])), "Tensor/Malformed"),
            ("a storage with a text for its class", policy_with(tensor(sequence(text("storage"), text(FLOATS), text("0"),
                text("cpu"), integer(3)) + b"Q", 0, [3], [1])), "Tensor/Malformed"),
            ("a storage with a callable for its class", policy_with(tensor(storage("collections.OrderedDict", "0", 3), 0,
                [3], [1])), "Tensor/UnknownElementType", "collections.OrderedDict"),
            ("a storage of an unknown class", policy_with(tensor(storage("torch.QInt8Storage", "0", 3), 0, [3], [1])),
                "Pickle/UnknownGlobal", "torch.QInt8Storage"),
            ("a storage described in two ways", policy(torch_file(state(**two, action_net__b=vector("0", 2)), {"0": ONES})),
                "Tensor/Malformed", "two ways"),
            ("a storage read as two types", policy(torch_file(state(**two, action_net__b=tensor(
                storage("torch.IntStorage", "0", 3), 0, [3], [1])), {"0": ONES})), "Tensor/Malformed", "two ways"),
            ("one name twice", policy(torch_file(pickle(mapping(*[(text("action_net.a"), vector("0", 3))] * 2)),
                {"0": ONES})), "Tensor/Duplicate", "action_net.a"),
            ("a weight that is no number", policy_of(vector("0", 3), _0=floats(1, math.nan, 1)), "Tensor/NotFinite",
                "element 1"),
            ("an infinite weight", policy_of(vector("0", 3), _0=floats(1, 1, -math.inf)), "Tensor/NotFinite", "element 2"),
            ("a double too large for a float", policy_of(tensor(storage("torch.DoubleStorage", "0", 1), 0, [1], [1]),
                _0=struct.pack("<d", 1e300)), "Tensor/NotFinite"),
            ("a big-endian torch file", policy(torch_file(state(action_net__weight=vector("0", 3)), {"0": ONES}, b"big")),
                "Tensor/BigEndian"),
            ("a tensor name that would rewrite the terminal", policy(torch_file(pickle(mapping(
                (text("action_net.\x1b[2J"), vector("0", 3)))), {"0": ONES})), "Record"),
            ("a tensor name of a megabyte", policy(torch_file(pickle(mapping((text("a" * (1 << 20)), vector("0", 3)))),
                {"0": ONES})), "Record"),
            ("a tensor name that is a number", policy(torch_file(pickle(mapping((integer(1), vector("0", 3)))),
                {"0": ONES})), "Record"),
            ("a list instead of a state dictionary", policy(torch_file(pickle(items()), {})), "Record"),
            ("a number instead of a tensor", policy_with(integer(3)), "Tensor/Malformed"),
            ("a tensor of two arguments", policy_with(call("torch._utils._rebuild_tensor_v2", NONE, NONE)),
                "Tensor/Malformed"),
            ("a parameter of a parameter", policy_with(call("torch._utils._rebuild_parameter",
                call("torch._utils._rebuild_parameter", vector("0", 3)))), "Tensor/Malformed"),
            ("an empty state dictionary", policy(torch_file(state(), {})), "UnknownNetwork"),
            ("a network of an unknown kind", policy(torch_file(state(evil=vector("0", 3)), {"0": ONES})), "UnknownNetwork",
                "evil"),
            ("many names for one large storage", policy(torch_file(wide, {"0": floats(1) * (1 << 20)})), "Tensor/Limit",
                "bytes of memory"),
            ("many views that each unfold the whole storage", policy(torch_file(state(**turned),
                {"0": floats(1) * (1 << 18)})), "Tensor/Limit", "bytes of memory"),
        ],
    )  # fmt: skip


def streams():
    def with_stream(content):
        return gradient_policy(in_shift=embedded([2], content))

    two = floats(1, 1)
    rows = [
        ("a big-endian stream", with_stream(stream(2, two, little_endian=False)), "EmbeddedTensor/BigEndian"),
        ("a stream that is too short", with_stream(stream(2, floats(1))), "EmbeddedTensor/WrongLength"),
        ("a stream that is too long", with_stream(stream(2, floats(1, 1, 1))), "EmbeddedTensor/WrongLength"),
        ("a stream with another count", with_stream(stream(2, two, claimed=3)), "EmbeddedTensor/Overlapping"),
        ("a stream with a negative count", with_stream(stream(2, two, claimed=-1)), "EmbeddedTensor/Overlapping"),
        ("a stream with another magic number", with_stream(stream(2, two, magic=bytes(9) + b"\1")),
            "EmbeddedTensor/Malformed"),
        ("a stream cut short", with_stream(stream(2, two)[:40]), "EmbeddedTensor/Truncated"),
        ("an empty stream", with_stream(b""), "EmbeddedTensor/Truncated"),
        ("a stream without a number", with_stream(stream(2, floats(1, math.nan))), "EmbeddedTensor/NotFinite"),
    ]  # fmt: skip
    return cases("policy", [(attack, content, error, "in_shift") for attack, content, error in rows]) + cases(
        "policy",
        [
            ("a layer of another width", gradient_policy(in_shift=embedded([4])), "Tensor/WrongShape"),
            ("an unknown nonlinearity", gradient_policy(nonlinearity=NONE), "Record", "nonlinearity"),
        ],
    )
