"""LAS and LAZ files: the header by laspy, the points some at a time, those of LAZ in a process of its own."""

import dataclasses
import struct
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from jaxtyping import Float64

from gmmjax.clouds.cloud_file import Bounds, CloudFile, RowBlock
from gmmjax.clouds.decoder_process import DecoderProcess, DecodingError, Request
from gmmjax.clouds.records import require_records, stored_records
from gmmjax.clouds.reference_system import GEOTIFF_TEXTS, ReferenceSystem, of_geotiff_keys, of_wkt
from gmmjax.clouds.source_file import SourceFile
from gmmjax.errors import InputError, one_line, warn

if TYPE_CHECKING:
    from laspy import LasHeader

# Points a second that the slowest machine decompresses; it is killed where it takes longer.
SLOWEST = 50_000
# Of the classes of the point formats 0 to 5 the upper three bits are flags.
CLASS_BITS = 31
# The records that hold the reference system as well-known text, and as keys of GeoTIFF; bytes of the longest read.
PROJECTION_USER, WKT_RECORD, GEOTIFF_RECORD, LONGEST = "LASF_Projection", 2112, 34735, 1 << 20
# Bytes of the header up to LAS 1.2, and before the content of a variable-length record and of an extended one.
SHORTEST_HEADER, VLR_HEADER, EVLR_HEADER = 227, 54, 60
DAMAGED = "the file is damaged, copy or export it again"


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class LasFile(CloudFile):
    """A LAS or LAZ file; intensity and classification are columns, unit and system those of its WKT or GeoTIFF keys.

    Attributes:
        header: of the file.
    """

    header: "LasHeader"

    def blocks(self) -> Iterator[RowBlock]:
        """Yield all points, some at a time; raises an `InputError` where the file is damaged or cut off."""
        with record_blocks(self.path, self.header) as blocks:
            for rows in blocks:
                names = rows.dtype.names or ()
                flagged = "raw_classification" in names
                classes = rows["raw_classification"] & CLASS_BITS if flagged else rows["classification"]
                colors = np.stack([rows[name] for name in ("red", "green", "blue")], axis=1) if "red" in names else None
                columns = {"intensity": rows["intensity"], "classification": classes}
                yield RowBlock(coordinates(rows, self.header), columns, colors)


def open_las(path: Path) -> LasFile:
    """Open a LAS or LAZ file, and check its header.

    Raises:
        InputError: the file cannot be read, is damaged or cut off.

    Warns:
        InputWarning: heights in another unit than x and y.
    """
    source = SourceFile.of(path)
    header = read_header(path, source.size)
    system = _reference_system(header)
    if system.heights is not None:
        warn(
            f"{path}: states heights in {system.heights}, and x and y in another unit: distances and volumes would mix "
            "both; convert the heights to the unit of x and y"
        )
    return LasFile(
        path=path,
        source=source,
        count=header.point_count,
        unit=system.unit,
        crs=system.crs,
        bounds=Bounds(header.mins, header.maxs),
        header=header,
    )


def read_header(file: Path, size: int, *, whole: bool = False) -> "LasHeader":
    """Read the header of a LAS or LAZ file of so many bytes, with its extended records.

    Args:
        file: LAS or LAZ.
        size: bytes of the file.
        whole: whether extended records that run beyond the end are an error; the points can be read all the same.

    Raises:
        InputError: no LAS file, one of an unknown version, one that is cut off, or one that laspy does not read.
    """
    from laspy import LasHeader

    try:
        with file.open("rb") as stream:
            _check_layout(stream, size, file)
            stream.seek(0)
            header = LasHeader.read_from(stream)
            with nullcontext() if whole else suppress(InputError):
                if header.version.minor >= 4 and header.number_of_evlrs:
                    place = range(header.start_of_first_evlr, size)
                    _check_records(stream, place, header.number_of_evlrs, EVLR_HEADER, file)
                    header.read_evlrs(stream)
        _check_points(header, size, file)
        return header
    except InputError:
        raise
    except (OSError, MemoryError) as error:
        raise InputError(f"{file}: cannot be read ({error!r}); copy it to a local disk and try again") from error
    # laspy lets through whatever its parsing raises: of text, dates, numbers and types.
    except Exception as error:
        raise InputError(
            f"{file}: laspy cannot read its header ({type(error).__name__}: {one_line(error)}); copy or export it "
            "again, with all names in UTF-8"
        ) from error


def coordinates(rows: np.ndarray, header: "LasHeader") -> Float64[np.ndarray, "n 3"]:
    """Scale the coordinates of points that `record_blocks` gives."""
    # Scales of 1e300 make infinite coordinates, which are dropped and counted as everywhere.
    with np.errstate(over="ignore"):
        whole = zip("XYZ", header.scales, header.offsets, strict=True)
        return np.stack([rows[name] * scale + offset for name, scale, offset in whole], axis=1)


@contextmanager
def record_blocks(file: Path, header: "LasHeader") -> Iterator[Iterator[np.ndarray]]:
    """Give the points of a file as they are there, some at a time, with laspy's names of their dimensions.

    Raises:
        InputError: while they are read: the file is damaged or cut off.
    """
    if header.are_points_compressed and header.point_count:
        with DecoderProcess() as decoder:
            yield _decompressed(file, header, decoder)
    else:
        yield stored_records(file, header.offset_to_point_data, header.point_format.dtype(), header.point_count)


def _decompressed(file: Path, header: "LasHeader", decoder: DecoderProcess) -> Iterator[np.ndarray]:
    row_type, count = header.point_format.dtype(), header.point_count
    details = {
        "offset": header.offset_to_point_data,
        "vlr": header.vlrs.get("LasZipVlr")[0].record_data.hex(),
        "count": count,
        "record_length": row_type.itemsize,
    }
    # A chunk may hold all points, and is held beside the block that is asked for.
    request = Request("laz", file, "lazrs", 2 * count * row_type.itemsize, count / SLOWEST, details)
    try:
        for data in decoder.decode(request):
            yield np.frombuffer(data, row_type)
    except DecodingError as error:
        remedy = f"lazrs cannot read it ({one_line(error)}); {DAMAGED}"
        if "fill whole buffer" in str(error):
            remedy = remedy.replace("is damaged", "is cut off or damaged")
        elif error.name == "laszip":
            remedy = "is compressed by a newer LASzip than lazrs reads: pip install laszip, or convert it to LAS"
        elif error.kind in ("ModuleNotFoundError", "ImportError"):
            remedy = f"LAZ files need lazrs ({error}): pip install lazrs, or convert it to LAS"
        raise InputError(f"{file}: {remedy}") from error


def _reference_system(header: "LasHeader") -> ReferenceSystem:
    """The system of the coordinates; the WKT, where there is one, before the GeoTIFF keys."""
    records = [record for record in (*header.vlrs, *(header.evlrs or ())) if record.user_id == PROJECTION_USER]
    texts = {own.record_id: data for own in records if len(data := own.record_data_bytes()) < LONGEST}
    system = of_wkt(texts.get(WKT_RECORD, b"").decode("utf-8", "replace"))
    if system != ReferenceSystem():
        return system
    return of_geotiff_keys(texts.get(GEOTIFF_RECORD, b""), texts.get(GEOTIFF_TEXTS, b""))


def _check_layout(stream: BinaryIO, size: int, file: Path) -> None:
    """Check that the file is LAS and its bytes do not contradict its header: laspy believes any numbers."""
    head = stream.read(SHORTEST_HEADER)
    if head[:4] != b"LASF":
        raise InputError(f"{file}: is no LAS or LAZ file (it does not start with LASF); rename it to its real format")
    if len(head) < SHORTEST_HEADER:
        raise InputError(f"{file}: ends within its header, after {len(head)} bytes; copy it again")
    if head[24] != 1 or head[25] > 5:
        raise InputError(f"{file}: has version {head[24]}.{head[25]}, known are 1.0 to 1.5; export it as LAS 1.4")
    header_size, start, count = struct.unpack_from("<HII", head, 94)
    if not SHORTEST_HEADER <= header_size <= start <= size:
        raise InputError(
            f"{file}: has {size} bytes, a header of {header_size} and points from byte {start} on, which cannot be; "
            f"{DAMAGED}"
        )
    _check_records(stream, range(header_size, start), count, VLR_HEADER, file)


def _check_records(stream: BinaryIO, place: range, count: int, head: int, file: Path) -> None:
    """Check that so many variable-length records end where they must: laspy does not notice that they are cut off."""
    start = place.start
    for number in range(count):
        # The length stands before a description of 32 bytes.
        stream.seek(min(start, place.stop) + 20)
        start += head + int.from_bytes(stream.read(head - 52), "little")
        if start > place.stop:
            raise InputError(
                f"{file}: its {'extended ' * (head == EVLR_HEADER)}record {number} of {count} runs beyond byte "
                f"{place.stop}, where it must end; {DAMAGED}"
            )


def _check_points(header: "LasHeader", size: int, file: Path) -> None:
    """Check that there is room for the points, and their coordinates are numbers."""
    scales, offsets = header.scales, header.offsets
    if not (np.isfinite(scales).all() and np.isfinite(offsets).all() and (scales != 0).all()):
        raise InputError(f"{file}: has scales {scales.tolist()} and offsets {offsets.tolist()}; {DAMAGED}")
    if not header.are_points_compressed:
        room = size - header.offset_to_point_data
        require_records(file, room, header.point_format.dtype(), header.point_count, "points")
    elif not header.vlrs.get("LasZipVlr"):
        raise InputError(f"{file}: is compressed and has no record of LASzip; {DAMAGED}")
