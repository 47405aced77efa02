"""Reading LAS and LAZ files with laspy."""

import os
import struct
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds.colors import CHANNELS
from gmmjax.clouds.columns import AXES, cloud_of_columns
from gmmjax.clouds.files import require_file
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.errors import InputError

RECORD_SIZE, EXTENDED_RECORD_SIZE = 54, 60
"""Bytes that a variable-length record, and an extended one, take at least (LAS 1.4, tables 6 and 24)."""

CHUNK = 1_000_000
FIELDS = ("intensity", "classification")


def read_las(path: str | os.PathLike[str]) -> PointCloud:
    """The points of a LAS or LAZ file, versions 1.0 to 1.4.

    Scale and offset are applied in float64; 16-bit colours become bytes; intensity and classification become fields.

    Args:
        path: the file.

    Returns:
        The cloud, points in the order of the file.

    Raises:
        InputError: the file cannot be read, is damaged or cut off.
    """
    file = require_file(path)
    try:
        chunks, declared = _load(file)
    except (KeyboardInterrupt, SystemExit, InputError):
        raise
    # laspy raises what struct, NumPy and its own parser raise; the Rust decoder's panics are no Exception.
    except BaseException as error:
        raise InputError(
            f"{file}: laspy cannot read it ({error}); the file is damaged, copy or export it again"
        ) from error
    columns = (
        {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}
        if chunks
        else dict.fromkeys(AXES, np.zeros(0))
    )
    available = len(columns["x"])
    if available < declared:
        raise _cut_off(declared, available, file)
    return cloud_of_columns(columns, str(file))


def _load(file: Path) -> tuple[list[dict[str, np.ndarray]], int]:
    """The columns of the file's chunks, and the number of points that its header declares."""
    import laspy

    _check_records(file)
    with laspy.open(file) as reader:
        header = reader.header
        declared = int(header.point_count)
        available = (file.stat().st_size - int(header.offset_to_point_data)) // max(int(header.point_format.size), 1)
        if not header.are_points_compressed and available < declared:
            raise _cut_off(declared, max(available, 0), file)
        # In chunks, because laspy makes room for as many points as it is asked for, and a damaged number is billions.
        return [_columns(chunk) for chunk in reader.chunk_iterator(CHUNK)], declared


def _columns(chunk: Any) -> dict[str, np.ndarray]:
    columns = {axis: np.asarray(getattr(chunk, axis), np.float64) for axis in AXES}
    dimensions = set(chunk.point_format.dimension_names)
    return columns | {name: np.array(chunk[name]) for name in (*CHANNELS, *FIELDS) if name in dimensions}


def _cut_off(declared: int, available: int, file: Path) -> InputError:
    return InputError(f"{file}: declares {declared} points, {available} are there; the file is cut off, copy it again")


def _check_records(file: Path) -> None:
    """Check that the file has room for the records it declares: laspy would spend minutes on a damaged number."""
    with file.open("rb") as stream:
        header = stream.read(247)
    room = file.stat().st_size
    if header[:4] != b"LASF":
        raise InputError(f"{file}: is no LAS or LAZ file (it does not start with LASF); rename it to its real format")
    records = struct.unpack_from("<I", header, 100)[0] if len(header) >= 104 else 0
    has_extended = len(header) == 247 and header[25] >= 4
    extended_records = struct.unpack_from("<I", header, 243)[0] if has_extended else 0
    if records * RECORD_SIZE + extended_records * EXTENDED_RECORD_SIZE > room:
        raise InputError(
            f"{file}: declares {records + extended_records} records in its header, more than its {room} bytes hold; "
            "the file is damaged, copy it again"
        )
