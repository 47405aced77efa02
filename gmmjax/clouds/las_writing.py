"""Writing a LAS or LAZ file again with further dimensions: all that it held stays, byte for byte."""

import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.cloud_file import Bounds
from gmmjax.clouds.las import record_blocks
from gmmjax.clouds.las_coordinates import BoundsError, CoordinateEncoding
from gmmjax.clouds.las_extra_bytes import EXTRA_BYTES_RECORD, EXTRA_BYTES_USER, ExtraBytes
from gmmjax.clouds.las_header import (
    EXTENDED_VERSION,
    FIRST_EXTENDED_FORMAT,
    LASZIP_RECORD,
    LASZIP_USER,
    RECORD_SIZES,
    VLR_HEADER,
    WAVEFORM_VERSION,
    LasHeader,
    VariableRecord,
    extended_records,
    read_header,
)
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.source_file import SourceFile
from gmmjax.errors import InputError, warn

# lazrs 0.8 writes waveform packets that LASzip does not read (formats 4 and 5) or other ones than it is given (9, 10).
WAVEFORM_FORMATS = (4, 5, 9, 10)
# What describes how the points lie in the file, and not the points: compression, and the octree of COPC.
STORAGE_RECORDS = ((LASZIP_USER, LASZIP_RECORD), (b"copc", 1), (b"copc", 1000))
# LAStools' index by x and y, which is wrong for points that were moved.
INDEX_RECORD = (b"LAStools", 30)
MOST_BYTES = 2**16 - 1
PIECE = 1 << 24


@dataclass(frozen=True)
class LasSource:
    """A file that is to be written again.

    Attributes:
        file: LAS or LAZ.
        header: of it.
        extended: its extended records.
    """

    file: Path
    header: LasHeader
    extended: tuple[VariableRecord, ...]

    @classmethod
    def of(cls, source: SourceFile) -> "LasSource":
        """The file that a cloud was read from.

        Raises:
            InputError: it was changed since, or its extended records run beyond its end.
        """
        source.require_unchanged()
        with source.path.open("rb") as stream:
            header = read_header(stream, source.size, source.path)
            return cls(source.path, header, extended_records(stream, header, source.size, source.path))

    @property
    def compressed(self) -> bool:
        """Whether it is written as LAZ: where it is one, and lazrs writes its format without loss."""
        return self.header.laszip is not None and self.header.point_format not in WAVEFORM_FORMATS

    def represents(self, bounds: Bounds) -> bool:
        """Whether the file's scale and offset can represent all points in a box."""
        return bool(CoordinateEncoding.of_file(self.header).represents(bounds).all())

    @property
    def ending(self) -> str:
        """Of the file that is written."""
        return ".laz" if self.compressed else ".las"


class LasPart(NamedTuple):
    """Points of a block of a file that are to be written.

    Attributes:
        rows: of the block, ascending.
        points: where these points are now.
        dimensions: their values by name, of one of the types of `las_extra_bytes.EXTRA_TYPES`.
    """

    rows: Int64[np.ndarray, " n"]
    points: Float64[np.ndarray, "n 3"]
    dimensions: Mapping[str, np.ndarray]


PartOf = Callable[[int, Float64[np.ndarray, "n 3"]], LasPart]


def write_las(
    path: Path,
    source: LasSource,
    cloud: PointCloud,
    dimensions: Mapping[str, np.ndarray],
    descriptions: Mapping[str, str],
) -> None:
    """Writes the points of a LAS or LAZ file with further dimensions as extra bytes, whole or not at all.

    Version, point format, all dimensions and all records stay as they are. A point whose coordinates are those of the
    file keeps them bit for bit; others are rounded to the file's scale, and scale and offset change only where they
    cannot represent them. Dimensions of the file with the name of a new one become `input_NAME`.

    Args:
        path: the file to write.
        source: the file that the cloud was read from.
        cloud: its points, or some of them in their order, where they are now.
        dimensions: values of each point by name, of one of the types of `las_extra_bytes.EXTRA_TYPES`.
        descriptions: of each, in ASCII, at most 32 letters.

    Raises:
        InputError: the file does not hold these points, was changed, or is damaged.
        OSError: from writing, such as a full disk; `path` is then as it was.

    Warns:
        InputWarning: extra bytes that the file describes, but its points do not have.
    """
    if (np.diff(cloud.rows) <= 0).any() or cloud.rows[-1] >= source.header.count:
        raise InputError(f"{source.file}: does not hold the points of the cloud in their order; read it again")

    def part_of(first: int, coordinates: Float64[np.ndarray, "n 3"]) -> LasPart:
        place = slice(*map(int, np.searchsorted(cloud.rows, [first, first + len(coordinates)])))
        values = {name: own[place] for name, own in dimensions.items()}
        return LasPart(cloud.rows[place] - first, cloud.points[place], values)

    bounds = Bounds(cloud.points.min(axis=0), cloud.points.max(axis=0))
    described = {name: (values.dtype, descriptions[name]) for name, values in dimensions.items()}
    write_las_blocks(path, source, part_of, described, bounds)


def write_las_blocks(
    path: Path,
    source: LasSource,
    part_of: PartOf,
    descriptions: Mapping[str, tuple[np.dtype, str]],
    bounds: Bounds | None,
) -> None:
    """`write_las`, a block of the file at a time, for files of any size.

    Args:
        path: the file to write.
        source: the file that the points are read from.
        part_of: what is written of a block of the file, of its first row and its coordinates.
        descriptions: type of each dimension, and what it is, in ASCII, at most 32 letters.
        bounds: of all points that are written, where they are now; None: where they are in the file.

    Raises:
        InputError: the file was changed, or is damaged.
        BoundsError: a point outside the bounds, which the file's numbers cannot represent.
        OSError: from writing, such as a full disk; `path` is then as it was.

    Warns:
        InputWarning: as `write_las`.
    """
    header = source.header
    layout = _layout(source, descriptions)
    own = CoordinateEncoding.of_file(header)
    encoding = own if bounds is None else CoordinateEncoding.for_bounds(header, bounds)
    with source.file.open("rb") as original, atomic_write(path) as file:
        _write_front(file, original, source, layout)
        written = _write_points(file, source, layout, encoding, part_of)
        places = _write_extended(file, original, source, moved=not written.unmoved)
        head = _patched_header(original, source, layout, encoding, written, places)
        file.seek(0)
        file.write(head)


@dataclass(frozen=True)
class _Layout:
    """Where the parts of the new file are.

    Attributes:
        extra: what the extra bytes are.
        added: the type of those that are new, by name.
        kept: the records that stay.
        laszip: the record of the compression; None where there is none.
        record_length: bytes of a point.
        offset: where the points begin.
    """

    extra: ExtraBytes
    added: np.dtype
    kept: tuple[VariableRecord, ...]
    laszip: bytes | None
    record_length: int
    offset: int

    @property
    def number_of_records(self) -> int:
        """Of variable length."""
        return len(self.kept) + 1 + (self.laszip is not None)


@dataclass
class _Written:
    """What was written of the points.

    Attributes:
        count: how many.
        unmoved: whether all have the coordinates of the file.
        returns: how many of each return number, 0 to 15.
        lowest: integers of x, y and z.
        highest: integers of x, y and z.
    """

    count: int
    unmoved: bool
    returns: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray


def _is_extra(record: VariableRecord) -> bool:
    return (record.user, record.number) == (EXTRA_BYTES_USER, EXTRA_BYTES_RECORD)


def _layout(source: LasSource, descriptions: Mapping[str, tuple[np.dtype, str]]) -> _Layout:
    header = source.header
    available = header.record_length - RECORD_SIZES[header.point_format]
    described = next((record for record in (*header.records, *source.extended) if _is_extra(record)), None)
    content = b""
    if described is not None:
        with source.file.open("rb") as stream:
            content = described.content(stream)
    own, left_out = ExtraBytes.parse(content, available)
    if left_out:
        warn(
            f"{source.file}: describes {left_out} extra dimension(s) that its points have no bytes for, or that are "
            "damaged; they are left out of the result"
        )
    extra = own.avoiding(descriptions).with_dimensions(descriptions)
    added = np.dtype([(name, kind.newbyteorder("<")) for name, (kind, _) in descriptions.items()])
    record_length = header.record_length + added.itemsize
    if len(extra.content()) > MOST_BYTES or record_length > MOST_BYTES:
        raise InputError(f"{source.file}: has no room for further dimensions; export it with fewer extra bytes")
    kept = tuple(
        record
        for record in header.records
        if not _is_extra(record) and (record.user, record.number) not in STORAGE_RECORDS
    )
    laszip = None
    if source.compressed:
        import lazrs

        extra_length = record_length - RECORD_SIZES[header.point_format]
        laszip = bytes(lazrs.LazVlr.new_for_compression(header.point_format, extra_length, False).record_data())
    records = [record.head + record.length for record in kept]
    records += [VLR_HEADER + len(one) for one in (extra.content(), laszip) if one is not None]
    offset = header.size + sum(records) + _gap(header)
    if offset >= 2**32:
        raise InputError(f"{source.file}: has no room for further records before its points; export it again")
    return _Layout(extra, added, kept, laszip, record_length, offset)


def _gap(header: LasHeader) -> int:
    """Bytes between the last record and the points, which LAS 1.0 and some writers use."""
    return header.offset - max((record.end for record in header.records), default=header.size)


def _write_front(file: BinaryIO, original: BinaryIO, source: LasSource, layout: _Layout) -> None:
    """Header (which is patched in the end), records, and what lies before the points."""
    _copy(original, file, 0, source.header.size)
    for record in layout.kept:
        _copy(original, file, record.start, record.head + record.length)
    file.write(_record(EXTRA_BYTES_USER, EXTRA_BYTES_RECORD, "Extra Bytes Record", layout.extra.content()))
    if layout.laszip is not None:
        file.write(_record(LASZIP_USER, LASZIP_RECORD, "by lazrs of gmmjax", layout.laszip))
    gap = _gap(source.header)
    _copy(original, file, source.header.offset - gap, gap)


def _record(user: bytes, number: int, description: str, content: bytes) -> bytes:
    return struct.pack("<H16sHH32s", 0, user, number, len(content), description.encode()) + content


def _write_points(
    file: BinaryIO, source: LasSource, layout: _Layout, encoding: CoordinateEncoding, part_of: PartOf
) -> _Written:
    header, limits = source.header, np.iinfo(np.int32)
    written = _Written(0, encoding.kept, np.zeros(16, np.int64), np.full(3, limits.max), np.full(3, limits.min))
    return_bits = 15 if header.point_format >= FIRST_EXTENDED_FORMAT else 7
    first = 0
    with _sink(file, layout.laszip) as sink, record_blocks(source.file, header) as blocks:
        for block in blocks:
            part = part_of(first, header.coordinates(block["XYZ"]))
            first += len(block)
            if not len(part.rows):
                continue
            kept = _bytes_of(block)
            kept = kept if len(part.rows) == len(kept) else kept[part.rows]
            places = _placed(kept, part.points, source, encoding, written)
            extra = np.empty(len(kept), layout.added)
            for name in layout.added.names or ():
                extra[name] = part.dimensions[name]
            rows = np.concatenate([_bytes_of(places), kept[:, 12:], _bytes_of(extra)], axis=1)
            written.returns += np.bincount(rows[:, 14] & return_bits, minlength=16)
            written.count += len(rows)
            sink(rows)
    return written


def _bytes_of(rows: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)


def _placed(
    kept: np.ndarray,
    points: Float64[np.ndarray, "n 3"],
    source: LasSource,
    encoding: CoordinateEncoding,
    written: _Written,
) -> np.ndarray:
    """The integers of the points' coordinates.

    Args:
        kept: the bytes of the points in the file.
        points: where they are now.
        source: the file.
        encoding: how coordinates become integers.
        written: is told what is written.

    Raises:
        BoundsError: there are no integers for them.
    """
    xyz = np.ascontiguousarray(kept[:, :12]).view("<i4")
    unmoved = (source.header.coordinates(xyz) == points).all(axis=1)
    try:
        integers = encoding.integers(points, xyz, unmoved)
    except BoundsError as error:
        raise BoundsError(f"{source.file}: its points lie outside the bounds that it declares") from error
    written.unmoved &= bool(unmoved.all())
    written.lowest = np.minimum(written.lowest, integers.min(axis=0))
    written.highest = np.maximum(written.highest, integers.max(axis=0))
    return integers


@contextmanager
def _sink(file: BinaryIO, laszip: bytes | None) -> Iterator[Callable[[np.ndarray], object]]:
    """A function that takes the bytes of points [N, length], and writes them as they are or compressed."""
    if laszip is None:
        yield lambda rows: file.write(rows.tobytes())
        return
    import lazrs

    target = _RememberingFile(file)
    try:
        compressor = lazrs.ParLasZipCompressor(target, lazrs.LazVlr(laszip))
        yield lambda rows: compressor.compress_many(rows.reshape(-1))
        compressor.done()
    except BaseException as error:
        # lazrs raises an error of its own, which does not say that the disk is full.
        if target.failure is not None:
            raise target.failure from error
        raise


class _RememberingFile:
    """A file that lazrs writes to, and what went wrong with it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.failure: OSError | None = None
        self.seek, self.tell, self.flush = file.seek, file.tell, file.flush

    def write(self, content: bytes | bytearray | memoryview) -> int:
        try:
            return self._file.write(content)
        except OSError as error:
            self.failure = error
            raise


def _write_extended(file: BinaryIO, original: BinaryIO, source: LasSource, *, moved: bool) -> dict[int, int]:
    """Writes the extended records behind the points; where each is now, by where it was."""
    file.seek(0, 2)
    places = {}
    for record in source.extended:
        own = record.user, record.number
        if _is_extra(record) or own in STORAGE_RECORDS or (moved and own == INDEX_RECORD):
            continue
        places[record.start] = file.tell()
        _copy(original, file, record.start, record.head + record.length)
    return places


def _patched_header(
    original: BinaryIO,
    source: LasSource,
    layout: _Layout,
    encoding: CoordinateEncoding,
    written: _Written,
    places: Mapping[int, int],
) -> bytes:
    header = source.header
    original.seek(0)
    head = bytearray(original.read(header.size))
    struct.pack_into("<II", head, 96, layout.offset, layout.number_of_records)
    struct.pack_into("<BH", head, 104, header.point_format | 0x80 * source.compressed, layout.record_length)
    if written.count < header.count:
        _patch_counts(head, header, written)
    if not (written.unmoved and written.count == header.count):
        struct.pack_into("<6d", head, 131, *encoding.scales, *encoding.offsets)
        edges = (written.lowest, written.highest) * encoding.scales + encoding.offsets
        low, high = edges.min(axis=0), edges.max(axis=0)
        struct.pack_into("<6d", head, 179, *np.stack([high, low], axis=1).ravel())
    if header.minor >= WAVEFORM_VERSION:
        waveforms = struct.unpack_from("<Q", head, 227)[0]
        struct.pack_into("<Q", head, 227, places.get(waveforms, waveforms))
    if header.minor >= EXTENDED_VERSION:
        struct.pack_into("<QI", head, 235, min(places.values(), default=0), len(places))
    return bytes(head)


def _patch_counts(head: bytearray, header: LasHeader, written: _Written) -> None:
    """The number of points, and of those of each return, where some have no position and were left out."""
    if header.minor < EXTENDED_VERSION or header.point_format < FIRST_EXTENDED_FORMAT:
        struct.pack_into("<6I", head, 107, written.count, *written.returns[1:6])
    if header.minor >= EXTENDED_VERSION:
        struct.pack_into("<16Q", head, 247, written.count, *written.returns[1:16])


def _copy(source: BinaryIO, target: BinaryIO, start: int, length: int) -> None:
    """Bytes of one file at the place of the other."""
    source.seek(start)
    while length:
        piece = source.read(min(length, PIECE))
        if not piece:
            raise InputError(f"{source.name}: was changed while it was read; run the detection again")
        target.write(piece)
        length -= len(piece)
