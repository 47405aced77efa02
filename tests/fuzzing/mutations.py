"""Mutations of the bytes of a file."""

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from random import Random

# What breaks readers: the ends of the whole numbers, and what is no number.
WHOLE = (0, 1, 2, 3, 7, 127, 128, 255, 256, 32767, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1)
WORDS = (
    *(b"0", b"-1", b"1", b"3", b"255", b"256", b"65536", b"4294967295", b"18446744073709551616", b"99999999999"),
    *(
        b"0.5",
        b"-0.0",
        b"1e-400",
        b"1e308",
        b"1e999",
        b"-1e999",
        b"nan",
        b"NaN",
        b"inf",
        b"Infinity",
        b"1_000",
        b"0x1F",
    ),
    *(
        b"true",
        b"null",
        b"None",
        b'""',
        b'"text"',
        b"[]",
        b"{}",
        b"[1, 2]",
        b'{"a": 1}',
        b"\xff\xfe",
        b"'",
        b"#",
        b"\0",
    ),
    *(
        b"9" * 400,
        b"9" * 5000,
        b"0x" + b"F" * 5000,
        b"1." + b"1" * 5000,
        b"[" * 3000,
        b'{"a":' * 3000,
        b"[" * 90 + b"]" * 90,
    ),
    *(b"2020-01-01", b"999999-99-99T99:99:99", b"*id", b"!!python/object:os.system", b"&a [*a]"),
)
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
TOKEN = re.compile(rb"[A-Za-z_]+|[-+\d.eE]+|[\[\]{},:=\"']")
# Numbers of headers stand near the start of a file.
HEAD = 512
Mutation = Callable[[bytearray, bytes, Random], None]


def mutated(data: bytes, donor: bytes, random: Random) -> bytes:
    """A mutant of a file.

    Args:
        data: of a valid file.
        donor: another file, which pieces are taken from.
        random: decides.
    """
    mutant = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 3, 5))):
        random.choice(MUTATIONS)(mutant, donor, random)
    return bytes(mutant)


def mutated_archive(data: bytes, donor: bytes, random: Random) -> bytes:
    """An archive whose checksums are right, with a member that is mutated, missing, of another name or no array."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = random.choice(list(members))
    match random.randrange(8):
        case 0:
            members[name.removesuffix(".npy")] = members.pop(name)
        case 1:
            members[random.choice(list(members))] = members[name]
        case 2:
            del members[name]
        case 3:
            members[random.choice(("extra", "extra.npy", "../out.npy"))] = members[name][: random.randrange(200)]
        case _:
            members[name] = mutated(members[name], donor, random)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, content in members.items():
            archive.writestr(member, content)
    return stream.getvalue()


def mutated_png(data: bytes, donor: bytes, random: Random) -> bytes:
    """A PNG file whose checksums are right, with a chunk that is mutated, missing or repeated."""
    chunks, place = [], 8
    while place < len(data):
        length = int.from_bytes(data[place : place + 4], "big")
        chunks.append((data[place + 4 : place + 8], data[place + 8 : place + 8 + length]))
        place += 12 + length
    index = random.randrange(len(chunks))
    kind, content = chunks[index]
    match random.randrange(6):
        case 0:
            del chunks[index]
        case 1:
            chunks.insert(random.randrange(len(chunks)), chunks[index])
        case _ if kind == b"IDAT":
            chunks[index] = kind, zlib.compress(mutated(zlib.decompress(content), donor, random))
        case _:
            chunks[index] = kind, mutated(content, donor, random)
    return data[:8] + b"".join(
        len(content).to_bytes(4, "big") + kind + content + zlib.crc32(kind + content).to_bytes(4, "big")
        for kind, content in chunks
    )


def _flip(data: bytearray, donor: bytes, random: Random) -> None:
    for _ in range(random.choice((1, 1, 2, 8, 64))):
        if data:
            data[_place(data, random)] ^= 1 << random.randrange(8)


def _overwrite(data: bytearray, donor: bytes, random: Random) -> None:
    place, length = _place(data, random), random.choice((1, 2, 4, 16))
    data[place : place + length] = random.randbytes(min(length, len(data) - place))


def _truncate(data: bytearray, donor: bytes, random: Random) -> None:
    del data[random.randrange(len(data) + 1) :]


def _delete(data: bytearray, donor: bytes, random: Random) -> None:
    place = _place(data, random)
    del data[place : place + random.choice((1, 2, 4, 8, 100))]


def _insert(data: bytearray, donor: bytes, random: Random) -> None:
    place, length = _place(data, random), random.choice((1, 2, 4, 8, 100, 5000))
    data[place:place] = random.choice((random.randbytes(length), bytes(length), b"\xff" * length, b" " * length))


def _splice(data: bytearray, donor: bytes, random: Random) -> None:
    source = random.choice((donor, bytes(data)))
    start, place = random.randrange(len(source) + 1), _place(data, random)
    piece = source[start : start + random.choice((1, 8, 64, 1000))]
    data[place : place + random.choice((0, len(piece)))] = piece


def _whole_number(data: bytearray, donor: bytes, random: Random) -> None:
    place, (size, order) = _place(data, random), random.choice(((1, "<B"), (2, "<H"), (4, "<I"), (8, "<Q"), (4, ">I")))
    if place + size <= len(data):
        value = random.choice(WHOLE) + random.choice((0, 0, 0, -1, 1))
        data[place : place + size] = struct.pack(order, value % 256**size)


def _real_number(data: bytearray, donor: bytes, random: Random) -> None:
    place, order = _place(data, random), random.choice(("<f", "<d", ">d"))
    value = random.choice((0.0, -0.0, 1e-300, 1e30, float("nan"), float("inf"), -float("inf")))
    packed = struct.pack(order, value)
    if place + len(packed) <= len(data):
        data[place : place + len(packed)] = packed


def _word(data: bytearray, donor: bytes, random: Random) -> None:
    """Another word in place of one, most often of a number."""
    found = list(random.choice((NUMBER, NUMBER, TOKEN)).finditer(data, 0, 20_000))
    if found:
        start, end = random.choice(found).span()
        data[start:end] = random.choice(
            (*WORDS, *(other.group() for other in random.sample(found, min(3, len(found)))))
        )


def _line(data: bytearray, donor: bytes, random: Random) -> None:
    lines = bytes(data).split(b"\n")
    index, other = random.randrange(len(lines)), random.randrange(len(lines))
    match random.randrange(4):
        case 0:
            del lines[index]
        case 1:
            lines.insert(index, lines[other])
        case 2:
            lines[index], lines[other] = lines[other], lines[index]
        case _:
            lines[index] = lines[index] + random.choice((b" ", b"\r", b",", b"\t")) + random.choice(WORDS)
    data[:] = b"\n".join(lines)


MUTATIONS: tuple[Mutation, ...] = (
    *(_flip, _overwrite, _truncate, _delete, _insert, _splice),
    *(_whole_number, _whole_number, _real_number, _word, _word, _line),
)


def _place(data: bytearray, random: Random) -> int:
    """Anywhere in the file, or in its head."""
    return random.randrange(max(min(len(data), random.choice((HEAD, len(data)))), 1))
