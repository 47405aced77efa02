"""Reading LAS files, and LAZ files with lazrs in a process of its own."""

import dataclasses
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gmmjax.clouds.colors import color_bytes
from gmmjax.clouds.decoder_process import DecoderProcess, DecodingError, Request
from gmmjax.clouds.files import require_file
from gmmjax.clouds.las_header import (
    DAMAGED,
    FIRST_EXTENDED_FORMAT,
    LasHeader,
    LaszipLayout,
    extended_records,
    read_header,
)
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.reference_system import ReferenceSystem, of_geotiff_keys, of_wkt
from gmmjax.errors import InputError, one_line

# Bytes of records that are read at a time: beside the result, the memory that reading takes.
BLOCK = 1 << 26
# Points a second that the slowest machine decompresses; it is killed where it takes longer.
SLOWEST = 50_000
# Of the classes of the point formats 0 to 5 the upper three bits are flags.
CLASS_BITS = 31
# The records that hold the reference system as well-known text, and as keys of GeoTIFF.
PROJECTION_USER, WKT_RECORD, GEOTIFF_RECORD = b"LASF_Projection", 2112, 34735
# Bytes of the longest well-known text that is read.
LONGEST_WKT = 1 << 20


def read_las(path: str | os.PathLike[str]) -> PointCloud:
    """The points of a LAS or LAZ file, versions 1.0 to 1.4.

    Scale and offset are applied in float64; 16-bit colours become bytes; intensity and classification become fields.
    Unit and reference system are those of the WKT or the GeoTIFF keys.

    Args:
        path: the file.

    Returns:
        The cloud, points in the order of the file.

    Raises:
        InputError: the file cannot be read, is damaged or cut off.
    """
    file = require_file(path)
    try:
        with file.open("rb") as stream:
            size = file.stat().st_size
            header = read_header(stream, size, file)
            system = _reference_system(stream, header, size, file)
        with record_blocks(file, header) as blocks:
            cloud = _cloud(blocks, header, file)
        return dataclasses.replace(cloud, unit=system.unit, crs=system.crs)
    except (OSError, MemoryError) as error:
        raise InputError(f"{file}: cannot be read ({error!r}); copy it to a local disk and try again") from error


@contextmanager
def record_blocks(file: Path, header: LasHeader) -> Iterator[Iterator[np.ndarray]]:
    """The point records of a file, some at a time, as arrays of `header.row_type`.

    Args:
        file: LAS or LAZ.
        header: of the file.

    Raises:
        InputError: while they are read: the file is damaged or cut off.
    """
    if header.laszip is None:
        yield _stored(file, header)
        return
    with DecoderProcess() as decoder:
        yield _decompressed(file, header, header.laszip, decoder)


def _reference_system(stream: BinaryIO, header: LasHeader, size: int, file: Path) -> ReferenceSystem:
    """What the file says of its coordinates; the WKT, where there is one, before the GeoTIFF keys."""
    records = header.records
    try:
        records += extended_records(stream, header, size, file)
    # The points can be read all the same.
    except InputError:
        pass
    own = {record.number: record for record in records if record.user == PROJECTION_USER}
    if WKT_RECORD in own and own[WKT_RECORD].length < LONGEST_WKT:
        return of_wkt(own[WKT_RECORD].content(stream).decode("utf-8", "replace"))
    return of_geotiff_keys(own[GEOTIFF_RECORD].content(stream)) if GEOTIFF_RECORD in own else ReferenceSystem()


def _stored(file: Path, header: LasHeader) -> Iterator[np.ndarray]:
    """The records of a LAS file, a block at a time."""
    left, most = header.count, max(BLOCK // header.record_length, 1)
    with file.open("rb") as stream:
        stream.seek(header.offset)
        while left:
            rows = np.fromfile(stream, header.row_type, min(left, most))
            if not len(rows):
                raise InputError(f"{file}: ends {left} points before its end; copy it again")
            left -= len(rows)
            yield rows


def _decompressed(file: Path, header: LasHeader, laszip: LaszipLayout, decoder: DecoderProcess) -> Iterator[np.ndarray]:
    """The records of a LAZ file, a block at a time."""
    details = {
        "offset": header.offset,
        "vlr": laszip.vlr.hex(),
        "count": header.count,
        "record_length": header.record_length,
        "chunk_bytes": laszip.chunk_bytes,
    }
    # A chunk may hold all points, and is held beside the block that is asked for.
    memory = 2 * header.count * header.record_length
    try:
        for data in decoder.decode(Request("laz", file, "lazrs", memory, header.count / SLOWEST, details)):
            yield np.frombuffer(data, header.row_type)
    except DecodingError as error:
        if error.kind in ("ModuleNotFoundError", "ImportError"):
            raise InputError(
                f"{file}: LAZ files need lazrs ({error}): pip install lazrs, or convert it to LAS"
            ) from error
        raise InputError(f"{file}: lazrs cannot read it ({one_line(error)}); {DAMAGED}") from error


def _cloud(blocks: Iterator[np.ndarray], header: LasHeader, file: Path) -> PointCloud:
    try:
        points = np.empty((header.count, 3))
        columns = {
            name: np.empty((header.count, *kind.shape), kind.base)
            for name, (kind, *_) in (header.row_type.fields or {}).items()
            if name != "XYZ"
        }
    # NumPy's error where not even the number of bytes can be told.
    except (MemoryError, ValueError) as error:
        raise InputError(f"{file}: declares {header.count} points, more than the memory holds; {DAMAGED}") from error
    done = 0
    # Scales of 1e300 make infinite coordinates, which are dropped and counted as everywhere.
    with np.errstate(over="ignore"):
        for rows in blocks:
            place = slice(done, done + len(rows))
            points[place] = rows["XYZ"] * header.scales + header.offsets
            for name, values in columns.items():
                values[place] = rows[name]
            done += len(rows)
    colors = color_bytes(columns.pop("colors"), str(file)) if "colors" in columns else None
    if header.point_format < FIRST_EXTENDED_FORMAT:
        columns["classification"] &= CLASS_BITS
    return PointCloud.from_rows(points, colors, columns, str(file))
