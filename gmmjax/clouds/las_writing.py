"""Writing a LAS or LAZ file again with further dimensions, by laspy: the points' own bytes and the records stay."""

import copy
import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.clouds.atomic import atomic_write
from gmmjax.clouds.columns import free_name
from gmmjax.clouds.las import coordinates, read_header, record_blocks
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.source_file import SourceFile
from gmmjax.errors import InputError, one_line

if TYPE_CHECKING:
    from laspy import LasHeader

LARGEST = 2**31 - 1
# The types of dimensions that LAS has; letters of the longest name of one, and bytes of the longest without a type.
EXTRA_TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
LONGEST_NAME, LONGEST_UNTYPED = 32, 255
# lazrs 0.8 writes waveform packets that LASzip does not read (formats 4 and 5) or other ones than it is given (9, 10).
WAVEFORM_FORMATS = (4, 5, 9, 10)
# What describes how the points lie in the file, and not the points: the octree of COPC, and what laspy writes anew.
STORAGE_RECORDS = {("copc", 1), ("copc", 1000), ("laszip encoded", 22204), ("LASF_Spec", 4)}
# LAStools' index by x and y, which is wrong for points that were moved.
INDEX_RECORD = ("LAStools", 30)
# What says that the least and the greatest value are stated: laspy 2.7 states those of the first point of each block.
RANGE_BITS = 0b110


class LasSource(NamedTuple):
    """A file that is to be written again.

    Attributes:
        file: LAS or LAZ.
        header: of it, with its extended records.
    """

    file: Path
    header: "LasHeader"

    @classmethod
    def of(cls, source: SourceFile) -> "LasSource":
        """Read the header of the file that a cloud was read from.

        Raises:
            InputError: it was changed since, its extended records run beyond its end, or laspy does not write its like.
        """
        source.require_unchanged()
        header = read_header(source.path, source.size, whole=True)
        if header.version.minor == 0:
            raise InputError(f"{source.path}: is LAS 1.0, which is not written; convert it to LAS 1.2 or later")
        if header.global_encoding.waveform_data_packets_internal:
            raise InputError(f"{source.path}: holds waveforms, which are not written; export it without them")
        return cls(source.path, header)

    @property
    def compressed(self) -> bool:
        """True if the file is written as LAZ: it is one, and lazrs writes its format without loss."""
        return self.header.are_points_compressed and self.header.point_format.id not in WAVEFORM_FORMATS

    @property
    def ending(self) -> str:
        """Ending of the file that is written."""
        return ".laz" if self.compressed else ".las"


class LasPart(NamedTuple):
    """Points of a block of a file that are to be written.

    Attributes:
        rows: of the block, ascending.
        points: where these points are now.
        dimensions: their values by name, of one of the types of `EXTRA_TYPES`.
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
    """Write as `write_las_blocks` a cloud in memory.

    Args:
        path: the file to write.
        source: the file that the cloud was read from.
        cloud: its points, or some of them in their order, where they are now.
        dimensions: values of each point by name, of one of the types of `EXTRA_TYPES`.
        descriptions: of each, in ASCII, at most 32 letters.

    Raises:
        InputError, OSError: as `write_las_blocks`, or the file does not hold these points.
    """
    if (np.diff(cloud.rows) <= 0).any() or cloud.rows[-1] >= source.header.point_count:
        raise InputError(f"{source.file}: does not hold the points of the cloud in their order; read it again")
    described = {name: (values.dtype, descriptions[name]) for name, values in dimensions.items()}
    write_las_blocks(path, source, functools.partial(_part_of, cloud, dimensions), described)


def _part_of(
    cloud: PointCloud, dimensions: Mapping[str, np.ndarray], first: int, points: Float64[np.ndarray, "n 3"]
) -> LasPart:
    """The points of a cloud in memory that are of a block of its file."""
    place = slice(*map(int, np.searchsorted(cloud.rows, [first, first + len(points)])))
    values = {name: own[place] for name, own in dimensions.items()}
    return LasPart(cloud.rows[place] - first, cloud.points[place], values)


def write_las_blocks(
    path: Path, source: LasSource, part_of: PartOf, descriptions: Mapping[str, tuple[np.dtype, str]]
) -> None:
    """Write the points of a LAS or LAZ file with further dimensions as extra bytes, whole or not at all.

    Version, point format, scale, all dimensions, and the records as laspy keeps them, stay. A point whose coordinates
    are those of the file keeps them bit for bit; others are rounded to the file's scale, and the offset changes only
    where it does not reach the first of them. Dimensions of the file with the name of a new one become `input_NAME`.

    Args:
        path: the file to write.
        source: the file that the points are read from, a block at a time.
        part_of: gives what is written of a block of the file, of its first row and its coordinates.
        descriptions: type of each dimension, and what it is, in ASCII, at most 32 letters.

    Raises:
        InputError: the file was changed, is damaged, has what laspy does not write, or a scale too fine for its points.
        OSError: from writing, such as a full disk; `path` is then as it was.
    """
    with atomic_write(path) as file:
        target = _RememberingFile(file)
        try:
            _write(target, source, part_of, _extended_header(source, descriptions))
        except Exception as error:
            if target.failure is not None:
                raise target.failure from error
            if isinstance(error, InputError | OSError | MemoryError):
                raise
            raise InputError(
                f"{source.file}: laspy cannot write it again ({one_line(error)}); convert it with another program"
            ) from error


def _extended_header(source: LasSource, descriptions: Mapping[str, tuple[np.dtype, str]]) -> "LasHeader":
    """The header of the file with further dimensions."""
    from laspy import ExtraBytesParams

    header = copy.deepcopy(source.header)
    described = [own for record in header.vlrs.get("ExtraBytesVlr") for own in record.extra_bytes_structs]
    dimensions = header.point_format.dimensions
    taken = {*descriptions, *(own.name for own in dimensions)}
    if (longest := max(own.num_elements for own in dimensions)) > LONGEST_UNTYPED:
        raise InputError(
            f"{source.file}: has {longest} bytes a point without a description, more than the {LONGEST_UNTYPED} of "
            "one; export it with described extra bytes"
        )
    for place, dimension in enumerate(dimensions):
        if not dimension.is_standard and dimension.name in descriptions:
            dimensions[place] = dimension._replace(name=free_name(dimension.name, taken)[:LONGEST_NAME])
    header.vlrs = [own for own in header.vlrs if (own.user_id, own.record_id) not in STORAGE_RECORDS]
    header.add_extra_dims([ExtraBytesParams(name, kind, text) for name, (kind, text) in descriptions.items()])
    (record,) = header.vlrs.get("ExtraBytesVlr")
    for place, own in enumerate(described):
        # The file's own, since laspy forgets which value stands for no data.
        own.name = record.extra_bytes_structs[place].name
        record.extra_bytes_structs[place] = own
    for own in record.extra_bytes_structs:
        own.options &= ~RANGE_BITS if own.data_type else ~0
    return header


def _write(target: "_RememberingFile", source: LasSource, part_of: PartOf, header: "LasHeader") -> None:
    from laspy import LasWriter, LazBackend, PackedPointRecord
    from laspy.vlrs.vlrlist import VLRList

    backend = LazBackend.LazrsParallel if source.compressed else None
    row_type, first, moved, writer = header.point_format.dtype(), 0, False, None
    with record_blocks(source.file, source.header) as blocks:
        for block in blocks:
            places = coordinates(block, source.header)
            part = part_of(first, places)
            first += len(block)
            if writer is None:
                header.offsets = _offsets_for(part.points, header)
                writer = LasWriter(target, header, source.compressed, backend, closefd=False)
            rows = np.empty(len(part.rows), row_type)
            _bytes_of(rows)[:, : block.itemsize] = _bytes_of(block)[part.rows]
            moved |= _place(rows, part.points, (places[part.rows] != part.points).any(axis=1), header, source)
            for name, values in part.dimensions.items():
                rows[name] = values
            # Bounds beyond the range of floats are infinite.
            with np.errstate(over="ignore"):
                writer.write_points(PackedPointRecord(rows, header.point_format))
    assert writer is not None
    left_out = {*STORAGE_RECORDS, *([INDEX_RECORD] if moved else [])}
    if kept := [own for own in header.evlrs or () if (own.user_id, own.record_id) not in left_out]:
        writer.write_evlrs(VLRList(kept))
    writer.close()


def _bytes_of(rows: np.ndarray) -> np.ndarray:
    return rows.view(np.uint8).reshape(len(rows), rows.itemsize)


def _place(
    rows: np.ndarray, points: Float64[np.ndarray, "n 3"], moved: np.ndarray, header: "LasHeader", source: LasSource
) -> bool:
    """Put points where they are now, and tell whether any of them is written elsewhere than in its file."""
    if (header.offsets != source.header.offsets).any():
        moved = np.ones(len(rows), bool)
    with np.errstate(over="ignore", invalid="ignore"):
        whole = np.rint((points[moved] - header.offsets) / header.scales)
    if not (np.abs(whole) <= LARGEST).all():
        raise InputError(
            f"{source.file}: its scale {header.scales.tolist()} is too fine for its points where they are now; export "
            "it with a coarser one"
        )
    for axis, name in enumerate("XYZ"):
        rows[name][moved] = whole[:, axis]
    return bool(moved.any())


def _offsets_for(points: Float64[np.ndarray, "n 3"], header: "LasHeader") -> Float64[np.ndarray, "3"]:
    """The file's own offset of each axis where whole numbers of 32 bits reach the first point; else near that point."""
    if not len(points):
        return header.offsets
    with np.errstate(over="ignore", invalid="ignore"):
        reached = np.abs((points[0] - header.offsets) / header.scales) <= LARGEST
        return np.where(reached, header.offsets, np.rint(points[0] / header.scales) * header.scales)


class _RememberingFile:
    """A file that lazrs writes to, and what went wrong with it: its own error does not say that the disk is full."""

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
