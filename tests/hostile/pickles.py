"""Pickles that grow without end, or that are malformed."""

import struct

from cases import cases
from pieces import *  # noqa: F403


def growing():
    deep_state = (name("numpy.dtype") + b")R") * 1_000 + b"b" * 999
    rows = [
        ("lists in lists", b"]" * 100_000 + b"a" * 99_999, "Limit", "levels of nesting"),
        ("tuples in tuples", b")" + b"\x85" * 100_000, "Limit", "levels of nesting"),
        ("dictionaries in dictionaries", b"}N" * 1_000 + b"}" + b"s" * 1_000, "Limit", "levels of nesting"),
        ("states in states", deep_state, "Limit", "levels of nesting"),
        ("a full memo", b"N" + b"\x94" * 500_000, "Limit", "values in the memo"),
        ("a memo with one huge number", b"Nr\xff\xff\xff\xff", "Limit", "values in the memo"),
        ("a memo with one huge number in text", b"Np99999999999999999\n", "Limit", "values in the memo"),
        ("a full stack", b"N" * 500_000, "Limit", "values on the stack"),
        ("a stack filled by repetition", b"N" + b"2" * 500_000, "Limit", "values on the stack"),
        ("marks without end", b"(" * 500_000, "Limit", "open marks"),
        ("opcodes without end", b"N0" * 1_000_000 + b"N", "Limit", "pickle opcodes"),
        ("triples without end", b"](" + b"NNNNNNNNt\x94" + b"h\x00h\x00h\x00\x87" * 900_000, "Limit"),
        ("names without end", b"cnumpy\ndtype\n0" * 600_000 + b"N", "Limit"),
        ("empty dictionaries without end", b"}0" * 700_000 + b"N", "Limit"),
        ("texts without end", (text("x") + b"0") * 600_000 + b"N", "Limit"),
        ("a list that holds itself", b"]\x94h\x00a", "Recursive"),
        ("a dictionary that holds itself", b"}\x94Nh\x00s", "Recursive"),
        ("a dictionary that is its own key", b"}\x94h\x00Ns", "Recursive"),
        ("a record that is its own state", name("numpy.dtype") + b")R\x94h\x00b", "Recursive"),
        ("two lists that hold each other", b"]\x94]\x94ah\x01h\x00a0", "Recursive"),
    ]
    # Each list is ten times the list before; only the last stays on the stack.
    laughs = b"]\x940" + b"".join(b"](" + bytes([0x68, level]) * 10 + b"e\x940" for level in range(30)) + b"h\x1e"
    double = b"N" + b"2\x86" * 60
    return cases("normaliser", [(what, pickle(code), f"Pickle/{error}", *says) for what, code, error, *says in rows]) + cases(
        "normaliser",
        [
            # Shared, not copied: 2^60 and 10^30 leaves cost what they are written in.
            ("a pair of pairs, doubled sixty times", pickle(double), "NotANormaliser"),
            ("a billion laughs", pickle(laughs), "NotANormaliser"),
        ],
    )


def malformed():
    huge = struct.pack("<Q", 2**64 - 1)
    good = component_normaliser()
    smuggled = [
        ("a protocol in the middle", b"\x80\x04N", "UnsupportedProtocol"),
        ("popping below a mark", b"(0)(\x85", "EmptyStack"),
        ("a value never kept", b"j\xff\xff\xff\xff", "UnknownMemo", "4294967295"),
        ("a value never kept, by text", b"g7\n", "UnknownMemo"),
        ("a memo number below zero", b"Np-1\n", "InvalidText"),
        ("a memo number that is no number", b"Npx\n", "InvalidText"),
        ("BINUNICODE8 of 2^64 bytes", b"\x8d" + huge, ""),
        ("BINBYTES8 of 2^64 bytes", b"\x8e" + huge, ""),
        ("BYTEARRAY8 of 2^63 bytes", b"\x96" + struct.pack("<Q", 2**63), ""),
        ("BINBYTES of 2^32 bytes", b"B\xff\xff\xff\xff", "Truncated"),
        ("a text of -1 bytes", b"T\xff\xff\xff\xff", "ImpossibleLength", "-1"),
        ("a frame of 2^64 bytes", b"\x95" + huge, "ImpossibleLength", "18446744073709551615"),
        ("LONG1 beyond the end", b"\x8a\xff", ""),
        ("LONG4 of -1 bytes", b"\x8b\xff\xff\xff\xff", "ForbiddenOpcode"),
        ("a text that is not UTF-8", b"X\x01\x00\x00\x00\xff", "InvalidText"),
        ("half a surrogate", b"X\x03\x00\x00\x00\xed\xa0\x80", "InvalidText"),
        ("a name without an end", b"c" + b"a" * 100_000, "InvalidText"),
        ("half a pair", b"}(Nu", "WrongOperand", "SETITEMS"),
        ("adding to a tuple", b")Na", "WrongOperand", "APPEND"),
        ("adding to a number", b"NNNs", "WrongOperand", "SETITEM"),
        ("adding to a text", text("x") + b"(Ne", "WrongOperand", "APPENDS"),
        ("adding set items to a list", b"](N\x90", "WrongOperand", "ADDITEMS"),
    ]
    whole = [
        ("nothing", b"", "UnknownFormat"),
        ("a text file", b"hello", "UnknownFormat"),
        ("protocol 9", b"\x80\x09" + good[2:], "UnknownFormat"),
        ("an empty pickle", pickle(b""), "Pickle/EmptyStack"),
        ("two values", pickle(b"NN"), "Pickle/LeftoverValues"),
        ("an open mark", pickle(b"(N0N"), "Pickle"),
        ("bytes after the end", good + bytes(5), "Pickle/TrailingBytes", "5 bytes"),
        ("a second pickle after the first", good + good, "Pickle/TrailingBytes"),
        ("an archive after the pickle", good + GOOD_WEIGHTS, "Pickle/TrailingBytes"),
        ("the first half", good[: len(good) // 2], "Pickle/Truncated"),
        ("all but the last byte", good[:-1], "Pickle/Truncated"),
        ("a policy instead of a normaliser", gradient_policy(), "NotANormaliser"),
        ("an archive instead of a normaliser", policy(), "NotANormaliser"),
    ]
    return cases(
        "normaliser",
        [(what, component_normaliser(smuggled=code), f"Pickle/{error}", *says) for what, code, error, *says in smuggled]
        + whole,
    )
