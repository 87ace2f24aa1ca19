"""A zip writer that can lie: every field of every header may be given another value than the right one."""

import struct
import zlib
from dataclasses import dataclass, field

STORED, DEFLATED = 0, 8
MIDNIGHT = {"time": 0, "date": 33}  # 1 January 1980, the first moment of the format


@dataclass
class Member:
    """One member. `both`, `local` and `central` replace fields of its headers; with `place`, the directory's entry points
    there and no data are written. `packed` replaces the packed bytes."""

    name: str | bytes
    content: bytes = b""
    deflated: bool = False
    packed: bytes | None = None
    both: dict = field(default_factory=dict)
    local: dict = field(default_factory=dict)
    central: dict = field(default_factory=dict)
    place: int | None = None

    def fields(self):
        name = self.name.encode() if isinstance(self.name, str) else self.name
        packed = self.packed
        if packed is None:
            packed = deflate(self.content) if self.deflated else self.content
        return packed, MIDNIGHT | {
            "version": 20,
            "flags": 0,
            "method": DEFLATED if self.deflated else STORED,
            "crc": zlib.crc32(self.content),
            "packed": len(packed),
            "size": len(self.content),
            "name": name,
            "extra": b"",
            "comment": b"",
            "attributes": 0o100644 << 16,
        }


def deflate(content):
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    return packer.compress(content) + packer.flush()


def local_header(f):
    numbers = (f["version"], f["flags"], f["method"], f["time"], f["date"], f["crc"], f["packed"], f["size"])
    lengths = (f.get("name_length", len(f["name"])), f.get("extra_length", len(f["extra"])))
    return b"PK\3\4" + struct.pack("<5H3I2H", *numbers, *lengths) + f["name"] + f["extra"]


def central_header(f):
    made_by_unix = 3 << 8 | 20
    numbers = (f["version"], f["flags"], f["method"], f["time"], f["date"], f["crc"], f["packed"], f["size"])
    lengths = (f.get("name_length", len(f["name"])), f.get("extra_length", len(f["extra"])), len(f["comment"]))
    rest = (0, 0, f["attributes"], f["offset"])
    start = b"PK\1\2" + struct.pack("<6H3I3H2H2I", made_by_unix, *numbers, *lengths, *rest)
    return start + f["name"] + f["extra"] + f["comment"]


def wide_end(members, length, offset, place):
    """The two ZIP64 records, which say the same in eight bytes each."""
    record = b"PK\6\6" + struct.pack("<QHHIIQQQQ", 44, 45, 45, 0, 0, members, members, length, offset)
    return record + b"PK\6\7" + struct.pack("<IQI", 0, place, 1)


def archive(members, wide=None, end=None, tail=b""):
    """An archive of `members`: a dictionary of stored contents, or a list of `Member`. `wide` adds ZIP64 records and
    replaces their fields, `end` replaces fields of the end record, `tail` follows it."""
    if isinstance(members, dict):
        members = [Member(name, content) for name, content in members.items()]
    body, directory = bytearray(), b""
    entries = []
    for member in members:
        packed, fields = member.fields()
        fields |= member.both
        offset = len(body)
        if member.place is None:
            body += local_header(fields | member.local) + packed
        else:
            offset = member.place
        entries.append(central_header(fields | {"offset": offset} | member.central))
    directory = b"".join(entries)
    place = len(body) + len(directory)
    right = {"members": len(members), "length": len(directory), "offset": len(body)}
    records = b""
    if wide is not None:
        records = wide_end(**(right | {"place": place} | wide))
    f = {"disk": 0, "here": None, "comment": b""} | right | (end or {})
    here = f["members"] if f["here"] is None else f["here"]
    records += b"PK\5\6" + struct.pack(
        "<4H2IH", f["disk"], 0, here & 0xFFFF, f["members"] & 0xFFFF, f["length"], f["offset"], len(f["comment"])
    )
    return bytes(body) + directory + records + f["comment"] + tail


def quoted_overlap(files, kernel):
    """David Fifield's bomb: every member's data quote the header of the next and go on into its data, so that all of them
    end in the same kernel (USENIX WOOT 2019)."""
    packed, content = deflate(kernel), kernel
    blocks = []
    for index in reversed(range(files)):
        member = Member(f"{index:04}.bin", content, True, packed)
        _, fields = member.fields()
        header = local_header(fields)
        blocks.append((header, fields))
        # A stored block of deflate, not the last: the header as data, then whatever follows.
        packed = struct.pack("<BHH", 0, len(header), len(header) ^ 0xFFFF) + header + packed
        content = header + content
    blocks.reverse()
    body, entries = bytearray(), []
    for index, (header, fields) in enumerate(blocks):
        entries.append(central_header(fields | {"offset": len(body)}))
        body += header
        if index + 1 < files:
            body += struct.pack("<BHH", 0, len(blocks[index + 1][0]), len(blocks[index + 1][0]) ^ 0xFFFF)
    body += deflate(kernel)
    directory = b"".join(entries)
    end = b"PK\5\6" + struct.pack("<4H2IH", 0, 0, files, files, len(directory), len(body), 0)
    return bytes(body) + directory + end
