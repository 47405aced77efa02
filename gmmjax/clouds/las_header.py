"""The header of a LAS or LAZ file (ASPRS LAS 1.4 and 1.5, LASzip), checked against the bytes that are there."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Float64

from gmmjax.errors import InputError

# Bytes of the public header block of each minor version, and of a record of each point format, at least.
HEADER_SIZES = (227, 227, 227, 235, 375, 393)
RECORD_SIZES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
# Where red, green and blue stand in a record of each point format that has them.
COLOR_OFFSETS = {2: 20, 3: 28, 5: 28, 7: 30, 8: 30, 10: 30}
FIRST_EXTENDED_FORMAT = 6
VLR_HEADER, EVLR_HEADER = 54, 60
# From these versions on there is one extended record, of waveforms, and any number of them.
WAVEFORM_VERSION, EXTENDED_VERSION = 3, 4
# Of the global encoding: the waveforms are in the file.
INTERNAL_WAVEFORMS = 2
LASZIP_USER, LASZIP_RECORD = b"laszip encoded", 22204
LASZIP_SIZE, LASZIP_ITEM = 34, 6
CHUNKED = (2, 3)
# LASzip's items of each point format, and the bytes of each item; the item of further bytes is 0, or 14.
ITEMS = ((6,), (6, 7), (6, 8), (6, 7, 8), (6, 7, 9), (6, 7, 8, 9), (10,), (10, 11), (10, 12), (10, 13), (10, 12, 13))
ITEM_SIZES = {6: 20, 7: 8, 8: 6, 9: 29, 10: 30, 11: 6, 12: 8, 13: 29}
EXTRA_BYTES = (0, 14)
# Of the items of point formats 6 to 10, the version that lazrs reads.
LAZRS_VERSION = 3
CHUNKS_DIFFER = 2**32 - 1
FEW_RECORDS = "the file is cut off, copy it again"
DAMAGED = "the file is damaged, copy or export it again"


@dataclass(frozen=True)
class LaszipLayout:
    """How the points are compressed.

    Attributes:
        vlr: the record that tells the decompressor.
        chunk_bytes: of all chunks together.
    """

    vlr: bytes
    chunk_bytes: int

    @property
    def unknown_version(self) -> int | None:
        """The version of an item of point formats 6 to 10 that lazrs does not read, such as 4; None: there is none."""
        items = struct.iter_unpack("<HHH", self.vlr[LASZIP_SIZE:][: LASZIP_ITEM * self.vlr[LASZIP_SIZE - 2]])
        return next((version for kind, _, version in items if kind >= 10 and version != LAZRS_VERSION), None)


@dataclass(frozen=True)
class VariableRecord:
    """A variable-length record, or an extended one, which lies behind the points.

    Attributes:
        user: who defined it.
        number: what it is to the user.
        start: where its header begins in the file.
        head: bytes of its header.
        length: bytes of its content.
    """

    user: bytes
    number: int
    start: int
    head: int
    length: int

    @property
    def end(self) -> int:
        """The byte after it."""
        return self.start + self.head + self.length

    def content(self, stream: BinaryIO) -> bytes:
        """What it holds.

        Args:
            stream: of the file.
        """
        stream.seek(self.start + self.head)
        return stream.read(self.length)


@dataclass(frozen=True)
class LasHeader:
    """What a file declares; there is room for it.

    Attributes:
        minor: of the version 1.0 to 1.5.
        size: bytes of the header.
        point_format: 0 to 10.
        record_length: bytes of a point.
        count: how many points.
        offset: where they begin.
        scales: of x, y and z.
        offsets: added to x, y and z.
        lower: lowest x, y and z, as declared.
        upper: highest x, y and z, as declared.
        laszip: None where the points are not compressed.
        records: the variable-length records, between header and points.
    """

    minor: int
    size: int
    point_format: int
    record_length: int
    count: int
    offset: int
    scales: Float64[np.ndarray, "3"]
    offsets: Float64[np.ndarray, "3"]
    lower: Float64[np.ndarray, "3"]
    upper: Float64[np.ndarray, "3"]
    laszip: LaszipLayout | None
    records: tuple[VariableRecord, ...]

    def coordinates(self, integers: np.ndarray) -> Float64[np.ndarray, "n 3"]:
        """Coordinates of points.

        Args:
            integers: X, Y and Z [N, 3] as the file has them.
        """
        coordinates = np.empty(integers.shape)
        # Scales of 1e300 make infinite coordinates, which are dropped and counted as everywhere.
        with np.errstate(over="ignore"):
            # Axis by axis: NumPy is twice as fast along rows.
            for axis in range(3):
                coordinates[:, axis] = integers[:, axis] * self.scales[axis] + self.offsets[axis]
        return coordinates

    @property
    def row_type(self) -> np.dtype:
        """What is read of a record: X, Y, Z, intensity, classification, and where there are any, the colours."""
        extended = self.point_format >= FIRST_EXTENDED_FORMAT
        fields = {"XYZ": ("(3,)<i4", 0), "intensity": ("<u2", 12), "classification": ("u1", 16 if extended else 15)}
        if self.point_format in COLOR_OFFSETS:
            fields["colors"] = ("(3,)<u2", COLOR_OFFSETS[self.point_format])
        formats = [kind for kind, _ in fields.values()]
        offsets = [offset for _, offset in fields.values()]
        return np.dtype({"names": list(fields), "formats": formats, "offsets": offsets, "itemsize": self.record_length})


def read_header(stream: BinaryIO, size: int, file: Path) -> LasHeader:
    """The header of a file.

    Args:
        stream: of the file, seekable.
        size: bytes of the file.
        file: its name, for messages.

    Raises:
        InputError: no LAS file, one of an unknown version, or numbers that the file's own bytes contradict.
    """
    header = stream.read(max(HEADER_SIZES))
    if header[:4] != b"LASF":
        raise InputError(f"{file}: is no LAS or LAZ file (it does not start with LASF); rename it to its real format")
    major, minor = header[24:26] if len(header) > 25 else (0, 0)
    if len(header) < min(HEADER_SIZES) or (
        major == 1 and minor < len(HEADER_SIZES) and len(header) < HEADER_SIZES[minor]
    ):
        raise InputError(f"{file}: ends within its header, after {len(header)} bytes; {FEW_RECORDS}")
    if major != 1 or minor >= len(HEADER_SIZES):
        raise InputError(f"{file}: has version {major}.{minor}, known are 1.0 to 1.5; export it as LAS 1.4")
    header_size, offset, records = struct.unpack_from("<HII", header, 94)
    point_format, record_length, count = struct.unpack_from("<BHI", header, 104)
    if minor >= 4:
        count = struct.unpack_from("<Q", header, 247)[0]
    if not HEADER_SIZES[minor] <= header_size <= offset <= size:
        raise InputError(
            f"{file}: has {size} bytes, a header of {header_size} and points from byte {offset} on, which cannot be; "
            f"{DAMAGED}"
        )
    compressed, known_format = point_format & 0xC0 == 0x80, point_format & 0x3F
    if point_format & 0x40 or known_format >= len(RECORD_SIZES):
        raise InputError(f"{file}: has point format {point_format}, known are 0 to 10; export it as LAS 1.4")
    if record_length < RECORD_SIZES[known_format]:
        raise InputError(
            f"{file}: has points of {record_length} bytes, point format {known_format} takes "
            f"{RECORD_SIZES[known_format]}; {DAMAGED}"
        )
    scales, offsets = (np.array(struct.unpack_from("<3d", header, place)) for place in (131, 155))
    if not (np.isfinite(scales).all() and np.isfinite(offsets).all() and (scales != 0).all()):
        raise InputError(f"{file}: has scales {scales.tolist()} and offsets {offsets.tolist()}; {DAMAGED}")
    upper, lower = np.array(struct.unpack_from("<6d", header, 179)).reshape(3, 2).T
    vlrs = tuple(_vlrs(stream, header_size, offset, records, file))
    laszip = None
    if compressed and count:
        laszip = _laszip(stream, size, vlrs, (known_format, record_length, count, offset), file)
    elif not compressed and (size - offset) // record_length < count:
        available = (size - offset) // record_length
        raise InputError(f"{file}: declares {count} points, {available} are there; {FEW_RECORDS}")
    return LasHeader(
        minor=minor,
        size=header_size,
        point_format=known_format,
        record_length=record_length,
        count=count,
        offset=offset,
        scales=scales,
        offsets=offsets,
        lower=lower,
        upper=upper,
        laszip=laszip,
        records=vlrs,
    )


def extended_records(stream: BinaryIO, header: LasHeader, size: int, file: Path) -> tuple[VariableRecord, ...]:
    """The extended variable-length records, which lie behind the points.

    Args:
        stream: of the file.
        header: of the file.
        size: bytes of the file.
        file: its name, for messages.

    Raises:
        InputError: they run beyond the end of the file.
    """
    start, count = 0, 0
    if header.minor >= EXTENDED_VERSION:
        stream.seek(235)
        start, count = struct.unpack("<QI", stream.read(12))
    elif header.minor == WAVEFORM_VERSION:
        stream.seek(6)
        encoding = struct.unpack("<H", stream.read(2))[0]
        stream.seek(227)
        start = struct.unpack("<Q", stream.read(8))[0]
        count = int(bool(encoding & INTERNAL_WAVEFORMS) and start > 0)
    records: list[VariableRecord] = []
    for number in range(count):
        stream.seek(min(start, size))
        head = stream.read(EVLR_HEADER)
        if len(head) == EVLR_HEADER:
            user, record, length = struct.unpack_from("<16sHQ", head, 2)
            records.append(VariableRecord(user.rstrip(b"\0"), record, start, EVLR_HEADER, length))
        if len(head) < EVLR_HEADER or records[-1].end > size or start < header.offset:
            raise InputError(
                f"{file}: its extended record {number} of {count} runs beyond the end of the file, which has {size} "
                "bytes; the file is cut off or damaged, copy it again"
            )
        start = records[-1].end
    return tuple(records)


def _vlrs(stream: BinaryIO, start: int, end: int, count: int, file: Path) -> Iterator[VariableRecord]:
    """The variable-length records between header and points."""
    if count * VLR_HEADER > end - start:
        raise InputError(f"{file}: declares {count} records in {end - start} bytes; {DAMAGED}")
    place = start
    for number in range(count):
        stream.seek(place)
        head = stream.read(VLR_HEADER)
        place += VLR_HEADER
        if len(head) < VLR_HEADER or place > end:
            raise InputError(
                f"{file}: its record {number} of {count} ends after byte {end}, where the points begin; {DAMAGED}"
            )
        user, record, length = struct.unpack_from("<16sHH", head, 2)
        start_of_record = place - VLR_HEADER
        place += length
        if place > end:
            raise InputError(
                f"{file}: its record {number} of {count} ends after byte {end}, where the points begin; {DAMAGED}"
            )
        yield VariableRecord(user.rstrip(b"\0"), record, start_of_record, VLR_HEADER, length)


def _laszip(
    stream: BinaryIO,
    size: int,
    vlrs: tuple[VariableRecord, ...],
    points: tuple[int, int, int, int],
    file: Path,
) -> LaszipLayout:
    """The compression of points of a format, a record length, a number and an offset."""
    point_format, record_length, count, offset = points
    found = next((record for record in vlrs if (record.user, record.number) == (LASZIP_USER, LASZIP_RECORD)), None)
    if found is None:
        raise InputError(f"{file}: is compressed and has no record of LASzip; {DAMAGED}")
    vlr = found.content(stream)
    chunk_size = _check_vlr(vlr, point_format, record_length, file)
    stream.seek(offset)
    table = int.from_bytes(stream.read(8), "little", signed=True)
    if table == -1:
        # A writer that cannot go back leaves the place at the end.
        stream.seek(size - 8)
        table = int.from_bytes(stream.read(8), "little", signed=True)
    chunk_bytes = table - offset - 8
    if chunk_bytes < record_length or table + 8 > size:
        raise InputError(
            f"{file}: has its chunk table at byte {table}, points from byte {offset} on and {size} bytes; "
            "the file is cut off or damaged, copy it again"
        )
    stream.seek(table)
    version, chunks = struct.unpack("<II", stream.read(8))
    # The first point of a chunk is not compressed.
    if version != 0 or not 0 < chunks * record_length <= chunk_bytes:
        raise InputError(f"{file}: its chunk table has {chunks} chunks in {chunk_bytes} bytes; {DAMAGED}")
    # Where chunks differ, the size of one stands for the most points that any may have.
    least = 1 if chunk_size == CHUNKS_DIFFER else (chunks - 1) * chunk_size
    if not least <= count <= chunks * chunk_size:
        raise InputError(f"{file}: has {chunks} chunks of {chunk_size} points for {count} points; {DAMAGED}")
    return LaszipLayout(vlr, chunk_bytes)


def _check_vlr(vlr: bytes, point_format: int, record_length: int, file: Path) -> int:
    """The points of a chunk, where the record describes points of the format."""
    if len(vlr) < LASZIP_SIZE:
        raise InputError(f"{file}: has a record of LASzip of {len(vlr)} bytes; {DAMAGED}")
    compressor, coder = struct.unpack_from("<HH", vlr, 0)
    chunk_size = struct.unpack_from("<I", vlr, 12)[0]
    count = struct.unpack_from("<H", vlr, 32)[0]
    if compressor not in CHUNKED or coder != 0 or chunk_size == 0:
        raise InputError(
            f"{file}: is compressed by LASzip's method {compressor} with chunks of {chunk_size} points, known are 2 "
            "and 3; export it again, or as LAS"
        )
    room = (len(vlr) - LASZIP_SIZE) // LASZIP_ITEM
    items = [struct.unpack_from("<HHH", vlr, LASZIP_SIZE + LASZIP_ITEM * index) for index in range(min(count, room))]
    standard = [(kind, size) for kind, size, _ in items if kind not in EXTRA_BYTES]
    expected = [(kind, ITEM_SIZES[kind]) for kind in ITEMS[point_format]]
    if count > room or standard != expected or sum(size for _, size, _ in items) != record_length:
        raise InputError(
            f"{file}: its record of LASzip is not of points of format {point_format} with {record_length} bytes; "
            f"{DAMAGED}"
        )
    return int(chunk_size)
