"""Reading LAS files, and LAZ files with lazrs or laszip in a process of its own."""

import dataclasses
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gmmjax.clouds.cloud_file import Bounds, CloudFile, RowBlock
from gmmjax.clouds.decoder_process import DecoderProcess, DecodingError, Request
from gmmjax.clouds.files import require_file
from gmmjax.clouds.las_header import (
    COLOR_OFFSETS,
    DAMAGED,
    FIRST_EXTENDED_FORMAT,
    LasHeader,
    LaszipLayout,
    extended_records,
    read_header,
)
from gmmjax.clouds.records import stored_records
from gmmjax.clouds.reference_system import GEOTIFF_TEXTS, ReferenceSystem, of_geotiff_keys, of_wkt
from gmmjax.clouds.source_file import SourceFile
from gmmjax.errors import InputError, one_line, warn

# Points a second that the slowest machine decompresses; it is killed where it takes longer.
SLOWEST = 50_000
# Of the classes of the point formats 0 to 5 the upper three bits are flags.
CLASS_BITS = 31
# The records that hold the reference system as well-known text, and as keys of GeoTIFF.
PROJECTION_USER, WKT_RECORD, GEOTIFF_RECORD = b"LASF_Projection", 2112, 34735
# Bytes of the longest of them that is read.
LONGEST = 1 << 20


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class LasFile(CloudFile):
    """A LAS or LAZ file, versions 1.0 to 1.5.

    Scale and offset are applied in float64; intensity and classification are columns. Unit and reference system are
    those of the WKT or the GeoTIFF keys.

    Attributes:
        header: of the file.
    """

    header: LasHeader

    def blocks(self) -> Iterator[RowBlock]:
        """All points, some at a time.

        Raises:
            InputError: the file is damaged or cut off.
        """
        header = self.header
        with record_blocks(self.path, header) as blocks:
            for rows in blocks:
                classes = rows["classification"]
                if header.point_format < FIRST_EXTENDED_FORMAT:
                    classes = classes & CLASS_BITS
                columns = {"intensity": rows["intensity"], "classification": classes}
                yield RowBlock(
                    header.coordinates(rows["XYZ"]),
                    columns,
                    rows["colors"] if header.point_format in COLOR_OFFSETS else None,
                )


def open_las(path: str | os.PathLike[str]) -> LasFile:
    """A LAS or LAZ file, of which the header is read and checked.

    Args:
        path: the file.

    Raises:
        InputError: the file cannot be read, is damaged or cut off.

    Warns:
        InputWarning: heights in another unit than x and y.
    """
    file = require_file(path)
    source = SourceFile.of(file)
    try:
        with file.open("rb") as stream:
            header = read_header(stream, source.size, file)
            system = _reference_system(stream, header, source.size, file)
    except (OSError, MemoryError) as error:
        raise InputError(f"{file}: cannot be read ({error!r}); copy it to a local disk and try again") from error
    if system.heights is not None:
        warn(
            f"{file}: states heights in {system.heights}, and x and y in another unit: distances and volumes would mix "
            "both; convert the heights to the unit of x and y"
        )
    return LasFile(
        path=file,
        source=source,
        count=header.count,
        unit=system.unit,
        crs=system.crs,
        bounds=Bounds(header.lower, header.upper),
        header=header,
    )


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
        yield stored_records(file, header.offset, header.row_type, header.count)
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
    wanted = (WKT_RECORD, GEOTIFF_RECORD, GEOTIFF_TEXTS)
    texts = {number: own[number].content(stream) for number in wanted if number in own and own[number].length < LONGEST}
    system = of_wkt(texts.get(WKT_RECORD, b"").decode("utf-8", "replace"))
    if system != ReferenceSystem():
        return system
    return of_geotiff_keys(texts.get(GEOTIFF_RECORD, b""), texts.get(GEOTIFF_TEXTS, b""))


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
    version = laszip.unknown_version
    decoder_name, library = ("laz", "lazrs") if version is None else ("laszip", "laszip")
    try:
        for data in decoder.decode(Request(decoder_name, file, library, memory, header.count / SLOWEST, details)):
            yield np.frombuffer(data, header.row_type)
    except DecodingError as error:
        if version is not None:
            raise InputError(f"{file}: {_newer_laszip(version, error)}, or convert it to LAS") from error
        if error.kind in ("ModuleNotFoundError", "ImportError"):
            raise InputError(
                f"{file}: LAZ files need lazrs ({error}): pip install lazrs, or convert it to LAS"
            ) from error
        raise InputError(f"{file}: lazrs cannot read it ({one_line(error)}); {DAMAGED}") from error


def _newer_laszip(version: int, error: DecodingError) -> str:
    if error.kind in ("ModuleNotFoundError", "ImportError"):
        return f"is compressed by a newer LASzip (items of version {version}) than lazrs reads: pip install laszip"
    return (
        f"laszip cannot read it, which has items of version {version} ({one_line(error)}): pip install --upgrade "
        "laszip, copy it again if it is damaged"
    )
