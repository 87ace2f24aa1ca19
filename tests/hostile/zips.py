"""Zip archives that lie about their members, and settings that lie about themselves."""

import random
import struct

from archive import Member, archive, deflate, local_header, quoted_overlap
from cases import cases
from pieces import *  # noqa: F403
from programs import SYSTEM

MEGABYTE = 1 << 20
DATA = Member("data", SETTINGS)
WEIGHTS = Member("policy.pth", GOOD_WEIGHTS)


def with_member(*members, **ends):
    """A good policy with more members."""
    return archive([DATA, WEIGHTS, *members], **ends)


def with_data(content=SETTINGS, **lies):
    """A good policy whose settings are described wrongly."""
    return archive([Member("data", content, **lies), WEIGHTS])


def dense(size, ratio):
    """Bytes that deflate packs by about `ratio`: zeros with incompressible bytes among them."""
    noise = random.Random(size)
    block = 1 << 16
    return b"".join(noise.randbytes(block // ratio) + bytes(block - block // ratio) for _ in range(size // block))


def members():
    wide_extra = struct.pack("<HHQQ", 1, 16, 2**60, 2**60)
    rows = [
        ("two members of one name", with_member(Member("data", b"{}")), "Archive/DuplicateMember"),
        ("two names that differ by case", with_member(Member("Policy.PTH", GOOD_WEIGHTS)), "Archive/DuplicateMember"),
        ("two members in one place", with_member(Member("twin", SETTINGS, place=0)), "Archive"),
        ("a hundred members in one place", with_member(*[Member(f"data{k}", SETTINGS, place=0) for k in range(100)]),
            "Archive"),
        ("members that quote each other into one kernel", quoted_overlap(60, bytes(MEGABYTE // 8)), "Archive"),
        ("a symbolic link", with_member(Member("link", b"/etc/passwd", central={"attributes": 0o120777 << 16})),
            "Archive/SymbolicLink", "`link`"),
        ("settings that are a symbolic link", with_data(b"/etc/passwd", central={"attributes": 0o120777 << 16}),
            "Archive/SymbolicLink", "`data`"),
        ("a name that climbs out of the folder", with_member(Member("../../.bashrc")), "Archive/UnsafeName", "bashrc"),
        ("a name that climbs with backslashes", with_member(Member("..\\..\\evil")), "Archive/UnsafeName"),
        ("an absolute name", with_member(Member("/etc/cron.d/evil")), "Archive/UnsafeName", "/etc/cron.d/evil"),
        ("a name on a drive", with_member(Member("C:/evil")), "Archive/UnsafeName"),
        ("a name with a zero in it", with_member(Member("policy.pth\0.txt")), "Archive/UnsafeName"),
        ("a name that would rewrite the terminal", with_member(Member("\x1b[2J")), "Archive/UnsafeName"),
        ("a name that is not UTF-8", with_member(Member(b"\xff\xfe")), "Archive/UnsafeName"),
        ("a name of sixty thousand letters", with_member(Member("a" * 60_000)), "Archive/UnsafeName"),
        ("an empty name", with_member(Member("")), "Archive/UnsafeName"),
        ("an encrypted member", with_data(both={"flags": 1}), "Archive/EncryptedMember", "`data`"),
        ("a member with strong encryption", with_data(both={"flags": 0x41}), "Archive/EncryptedMember"),
        ("a member packed with bzip2", with_data(both={"method": 12}), "Archive/UnknownCompression"),
        ("a member packed with LZMA", with_data(both={"method": 14}), "Archive/UnknownCompression"),
        ("a member packed with an unknown method", with_data(both={"method": 0xEEEE}), "Archive/UnknownCompression"),
        ("a stored member that claims to unpack", with_data(both={"size": 1_000_000}), "Archive/WrongLength", "1000000"),
        ("a stored member that claims to shrink", with_data(both={"size": 1}), "Archive/WrongLength"),
        ("a deflated member that unpacks to more than it claims", with_data(deflated=True, both={"size": 5}), "Archive"),
        ("a deflated member that unpacks to less than it claims", with_data(deflated=True, both={"size": 500}), "Archive"),
        ("a member longer than the file", with_data(both={"packed": 2**30, "size": 2**30}), "Archive"),
        ("a member of 2^32 - 1 bytes", with_data(both={"packed": 2**32 - 1, "size": 2**32 - 1}), "Archive"),
        ("a member of 2^60 bytes in ZIP64", with_data(both={"packed": 2**32 - 1, "size": 2**32 - 1, "extra": wide_extra}),
            "Archive"),
        ("a damaged member", with_data(both={"crc": 1}), "Archive/DamagedMember", "`data`"),
        ("a damaged storage", policy(GOOD_WEIGHTS.replace(ONES, floats(1, 2, 1))), "Archive/DamagedMember"),
        ("a deflated member of noise", with_data(deflated=True, packed=b"\xff" * 50), "Archive"),
        ("a member without an end", with_data(deflated=True, packed=deflate(SETTINGS)[:-3]), "Archive"),
        ("another name before the member than in the directory", with_data(local={"name": b"dbta"}),
            "Archive/Contradiction"),
        ("another method before the member", with_data(local={"method": 8}), "Archive/Contradiction"),
        ("another size before the member", with_data(local={"size": 3, "packed": 3}), "Archive/Contradiction"),
        ("another checksum before the member", with_data(local={"crc": 3}), "Archive/Contradiction"),
        ("a member that only its own header encrypts", with_data(local={"flags": 1}), "Archive/Contradiction"),
        ("a member that the directory does not list", hidden_member(), "Archive/Contradiction"),
        ("a name longer than its header", with_data(both={"name_length": 60_000}), "Archive"),
        ("an extra field longer than its header", with_data(both={"extra_length": 60_000}), "Archive"),
        ("an extra field of ten thousand fields", with_data(both={"extra": struct.pack("<HH", 0x7777, 0) * 10_000}), None),
        ("a header beyond the file", with_data(central={"offset": 2**31}), "Archive"),
        ("a header inside another member", with_data(central={"offset": 50}), "Archive"),
    ]  # fmt: skip
    return cases("policy", rows)


def hidden_member():
    """Bytes between two members that are a member themselves, for readers that walk from header to header."""
    _, fields = Member("policy.pth", b"evil").fields()
    hidden = local_header(fields) + b"evil"
    start = len(local_header(DATA.fields()[1])) + len(SETTINGS)
    whole = archive([DATA, WEIGHTS], end={"offset": 0})
    body = whole[: whole.index(b"PK\1\2", start + len(GOOD_WEIGHTS))]
    shifted = archive([DATA, Member("policy.pth", GOOD_WEIGHTS, central={"offset": start + len(hidden)})])
    directory = shifted[len(body) :]
    end = bytearray(directory)
    struct.pack_into("<I", end, len(end) - 6, len(body) + len(hidden))
    return body[:start] + hidden + body[start:] + bytes(end)


def ends():
    good = policy()
    rows = [
        ("a directory of 65 535 members", with_member(end={"members": 65_535}), "Archive/Directory", "65535"),
        ("a directory of 2^62 members", with_member(wide={"members": 2**62}), "Archive/Directory"),
        ("a directory of 2^62 members and bytes", with_member(wide={"members": 2**62, "length": 2**63}),
            "Archive/Directory"),
        ("a directory shorter than its members", with_member(end={"members": 9}), "Archive/Directory"),
        ("a directory with one member less", with_member(end={"members": 1}), "Archive"),
        ("a directory beyond the end", with_member(end={"offset": 2**31}), "Archive/Directory"),
        ("a directory elsewhere", with_member(end={"offset": 7}), "Archive/Directory"),
        ("a ZIP64 directory elsewhere", with_member(wide={"offset": 7}), "Archive/Directory"),
        ("a ZIP64 record elsewhere", with_member(wide={"place": 7}), "Archive/Directory"),
        ("a ZIP64 record that says something else", with_member(wide={"members": 1}), "Archive/Directory"),
        ("a good archive with ZIP64 records", with_member(wide={}), None),
        ("one part of several", with_member(end={"disk": 1}), "Archive/Directory", "part"),
        ("fewer members on this disk", with_member(end={"here": 1}), "Archive/Directory"),
        ("something after the end", with_member(tail=b"\0"), "Archive/Directory", "does not end"),
        ("another archive after the end", good + archive({"data": b"evil", "policy.pth": GOOD_WEIGHTS}),
            "Archive/Directory"),
        ("a pickle after the end", good + pickle(SYSTEM), "Archive/Directory"),
        ("a comment that is an archive", with_member(end={"comment": good}), "Archive"),
        ("a shell script before the archive", b"#!/bin/sh\ntouch EXECUTED\nexit\n" + good, "UnknownFormat"),
        ("a picture before the archive", b"\x89PNG\r\n\x1a\n" + good, "UnknownFormat"),
        ("an empty archive", archive({}), "UnknownFormat"),
        ("an archive cut in half", good[: len(good) // 2], "Archive/Directory"),
        ("an archive without its last byte", good[:-1], "Archive/Directory"),
        ("an archive cut after the weights inside it", good[: good.index(GOOD_WEIGHTS) + len(GOOD_WEIGHTS)],
            "Archive/Directory"),
        ("thirty thousand members", archive({str(k): b"" for k in range(30_000)}), "Archive/TooManyMembers", "30000"),
        ("six thousand members of many extra fields", archive([Member(str(k), both={"extra": struct.pack("<HH", 0x7777, 0)
            * 250}) for k in range(6_000)]), "Archive"),
    ]  # fmt: skip
    return cases("policy", rows)


def bombs():
    zeros = bytes(32 * MEGABYTE)
    storage_file = archive([
        Member("archive/data.pkl", state(action_net__weight=vector("0", 24 * MEGABYTE))),
        Member("archive/data/0", dense(96 * MEGABYTE, 150), True),
    ])  # fmt: skip
    program = pickle(b"N0" * 1_000 + b"]" + b"N0" * 40_000_000)
    rows = [
        ("settings of zeros", with_data(zeros, deflated=True), "Archive/MemberTooLarge", "`data`"),
        ("settings of 200 MB, packed by less than the limit", with_data(dense(200 * MEGABYTE, 150), deflated=True),
            "Archive/MemberTooLarge", "bytes"),
        ("settings of 90 MB, packed by less than the limit", with_data(dense(90 * MEGABYTE, 150), deflated=True), "/"),
        ("a storage of 96 MB, packed by less than the limit", policy(storage_file), "Archive/MemberTooLarge"),
        ("weights in weights", archive([DATA, Member("policy.pth", archive([Member("archive/data.pkl", zeros, True)]),
            True)]), "Archive/MemberTooLarge"),
        ("archives in archives", archive([DATA, Member("policy.pth", nested(6))]), "NotATorchFile"),
        ("a program of eighty million opcodes", policy(archive([Member("archive/data.pkl", program, True)])), "Archive"),
    ]  # fmt: skip
    return cases("policy", rows)


def nested(levels):
    content = archive({"x": b""})
    for _ in range(levels):
        content = archive([Member(f"{k}.zip", content, True) for k in range(16)])
    return content


def contents():
    rows = [
        ("weights that are no archive", policy(b"PK\3\4 and nothing"), "Archive/Directory"),
        ("weights that are a pickle", policy(pickle(SYSTEM)), "Archive"),
        ("weights without a pickle", policy(archive({"x": b""})), "NotATorchFile", "policy.pth"),
        ("weights with two pickles", policy(archive({"a/data.pkl": b"", "b/data.pkl": b""})), "NotATorchFile"),
        ("weights whose pickle is empty", policy(torch_file(b"", {})), "Pickle/Truncated"),
        ("an archive of something else", archive({"x": b""}), "NotAPolicy"),
        ("a policy without settings", archive({"policy.pth": GOOD_WEIGHTS}), "NotAPolicy"),
        ("settings nested without end", policy(settings=b"[" * 1_000_000), "Settings", "`data`"),
        ("settings with ten million values", with_data(b"[0" + b",0" * 10_000_000 + b"]", deflated=True), "Archive"),
        ("settings with two million values", with_data(b"[" + b"0,\n{},".ljust(9) * 1_200_000 + b"0]"), "Limit"),
        ("settings that are no text", policy(settings=b"\xff\xfe"), "Settings"),
        ("settings in UTF-16", policy(settings=SETTINGS.decode().encode("utf-16")), "Settings"),
        ("settings with a number that is none", policy(settings=b'{"num_timesteps": NaN}'), "Settings"),
        ("settings with a number without end", policy(settings=b'{"num_timesteps": ' + b"9" * 1_000_000 + b"}"),
            "Settings"),
        ("settings with half a surrogate", policy(settings=b'{"num_timesteps": "\\ud800"}'), "Settings"),
        ("settings followed by more", policy(settings=SETTINGS + b"x"), "Settings"),
    ]  # fmt: skip
    return cases("policy", rows)

