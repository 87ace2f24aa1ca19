"""NumPy files, archives of them, and vocabularies."""

import json
import struct

from archive import Member, archive
from cases import cases
from pieces import pickle, text
from programs import SYSTEM


def npy(descr="'<f8'", order="False", shape="(3,)", data=bytes(24), version=1, header=None, length=None):
    header = (header or f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n").encode("latin-1")
    size = len(header) if length is None else length
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", size) + header + data


GOOD = npy()


def single():
    wrong_length, impossible, unreadable = "another length", "impossible size", "unreadable header"
    rows = [
        ("an array of objects", npy(descr="'|O'", data=pickle(SYSTEM)), "not supported"),
        ("an array of records", npy(descr="[('a', '<f8')]"), unreadable),
        ("an array of texts", npy(descr="'<U8'"), "U8"),
        ("an array of a type that would rewrite the terminal", npy(descr="'<\x1b[2J'"), "not supported"),
        ("big-endian numbers", npy(descr="'>f8'"), "little-endian"),
        ("numbers in this machine's order, whichever it is", npy(descr="'=f8'"), "little-endian"),
        ("more elements than bytes", npy(shape="(4,)"), wrong_length),
        ("fewer elements than bytes", npy(shape="(2,)"), wrong_length),
        ("a length that is no multiple of the element", npy(data=bytes(23)), wrong_length),
        ("a huge claimed shape", npy(shape="(1099511627776,)", data=b""), wrong_length),
        ("a shape that overflows", npy(shape="(4294967296, 4294967296)", data=b""), impossible),
        ("a shape that overflows only in bytes", npy(shape="(4611686018427387904,)", data=b""), wrong_length),
        ("a thousand axes", npy(shape="(" + "1, " * 1_000 + ")", data=bytes(8)), unreadable),
        ("a negative size", npy(shape="(-3,)"), unreadable),
        ("a size in exponent form", npy(shape="(1e3,)"), unreadable),
        ("a size beyond 64 bits", npy(shape="(18446744073709551616,)"), unreadable),
        ("a column-major array of three axes", npy(order="True", shape="(3, 1, 1)"), "column by column"),
        ("an order that is a number", npy(order="1"), unreadable),
        ("no shape", npy(header="{'descr': '<f8', 'fortran_order': False}"), unreadable),
        ("a header that is a program", npy(header="__import__('os').system('touch EXECUTED')"), unreadable),
        ("a header that is longer than the file", npy(length=60_000), "truncated"),
        ("a header of 2^32 bytes", npy(version=2, length=2**32 - 1), "truncated"),
        ("a header that is not UTF-8", npy(header="\xff\xfe"), unreadable),
        ("version 9", npy(version=9), "version"),
        ("a pickle instead of an array", pickle(SYSTEM), "no NumPy array"),
        ("only the magic number", b"\x93NUMPY", "truncated"),
        ("nothing", b"", "no NumPy array"),
    ]
    endless = npy(order="True", shape="(1152921504606846976, 0)", data=b"")
    return cases("npy", [(attack, content, "Array", *says) for attack, content, *says in rows]) + cases(
        "npy", [("a column-major array of 2^60 rows and no columns", endless, None)]
    )


def archives():
    zeros = npy(descr="'|b1'", shape=f"({40 << 20},)", data=bytes(40 << 20))
    rows = [
        ("a bomb of bytes that become eight each", archive([Member("a.npy", zeros, True)]), "Array", "bytes of memory"),
        ("a member that claims 2^31 bytes", archive([Member("a.npy", GOOD, True, both={"size": 2**31})]), "Array",
            "bytes of memory"),
        ("a member that claims less than it has", archive([Member("a.npy", GOOD, True, both={"size": 10})]), "Archive"),
        ("one name twice", archive([Member("a.npy", GOOD), Member("a.npy", npy(shape="(1, 3)"))]), "Archive", "one name"),
        ("an array of objects", archive({"a.npy": npy(descr="'|O'", data=pickle(SYSTEM))}), "Array", "`a`"),
        ("a damaged array", archive({"a.npy": GOOD}).replace(bytes(24), bytes(23) + b"\1"), "Archive"),
        ("a name that would rewrite the terminal", archive({"\x1b[2J.npy": b""}), "Array"),
        ("an encrypted array", archive([Member("a.npy", GOOD, both={"flags": 1})]), "Archive"),
        ("a directory of 65 535 members", archive({"a.npy": GOOD}, end={"members": 65_535}), "Archive", "65535"),
        ("something after the end", archive({"a.npy": GOOD}, tail=b"\0"), "Archive", "does not end"),
        ("the first half", archive({"a.npy": GOOD})[:60], "Archive"),
        ("a single array", GOOD, "Archive"),
        ("nothing", b"", "Archive"),
    ]  # fmt: skip
    return cases("npz", rows)


def vocabularies():
    rows = [
        ("ids with a gap", {"padding": 0, "hip": 2}, "hip"),
        ("one id twice", {"padding": 0, "hip": 0}, "used twice"),
        ("a negative id", {"padding": -1}, ""),
        ("half an id", {"padding": 0.5}, ""),
        ("an id beyond 16 bits", {"padding": 65_536}, ""),
        ("a list instead of an object", ["padding"], ""),
        ("an id that is a program", {"padding": "__import__('os').system('touch EXECUTED')"}, ""),
        ("an id that is a megabyte of text", {"padding": "\x1b" * (1 << 20)}, ""),
        ("a serialised object", {"padding": {":serialized:": "gASVAAAA"}}, ""),
        ("a word that would rewrite the terminal", {"\x1b[2J": 7}, ""),
    ]
    found = [(attack, json.dumps(content).encode(), "Vocabulary", *says) for attack, content, *says in rows]
    raw = [
        ("lists without end", b"[" * 1_000_000),
        ("nothing", b""),
        ("a text cut short", b'{"padding": 0'),
        ("no UTF-8", b'{"\xff": 0}'),
        ("a pickle", pickle(text("padding"))),
        ("no number", b'{"padding": NaN}'),
        ("a number without end", b'{"padding": ' + b"9" * 1_000_000 + b"}"),
    ]
    return cases("vocabulary", found + [(attack, content, "Vocabulary") for attack, content in raw])
