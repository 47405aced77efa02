"""Reading clouds from NumPy's .npy and .npz files, never from pickles."""

import math
import mmap
import warnings
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import IO

import numpy as np

from gmmjax.clouds.columns import AXES
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.records import RecordFile
from gmmjax.clouds.source_file import SourceFile
from gmmjax.errors import InputError, one_line

MAX_COLUMNS = 64
"""More columns than this are a transposed array rather than scalars of a point."""


def open_npy(path: Path) -> RecordFile | PointCloud:
    """Open an .npy file.

    Args:
        path: the file: numbers [N, 3] or more columns (`column_3`, `column_4`, ... become fields), or an ordered cloud
            [H, W, 3], which is flattened row by row.

    Returns:
        The file, with its header read; or, where the numbers lie column by column (Fortran's order), its points.

    Raises:
        InputError: the file cannot be read, holds pickled objects, or has another shape.
    """
    source = SourceFile.of(path)
    mapped = _mapped(path)
    if mapped is None:
        loaded = load_arrays(path)
        if isinstance(loaded, dict):
            raise InputError(f"{path}: is an .npz archive; rename it to .npz")
        return _cloud(loaded, path, {})
    _check_points(mapped, path)
    *grid, width = mapped.shape
    row_type = np.dtype([(name, mapped.dtype) for name in (*AXES, *_further_columns(width))])
    return RecordFile(path=path, source=source, count=math.prod(grid), offset=mapped.offset, row_type=row_type)


def _further_columns(width: int) -> list[str]:
    """Names of the columns beside the coordinates."""
    return [f"column_{index}" for index in range(3, width)]


def _mapped(path: Path) -> np.memmap | None:
    """The numbers of a file, not read, where they lie row by row; None where NumPy says what is wrong."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            mapped = np.lib.format.open_memmap(path, mode="r")
        # A damaged header may raise whatever Python's parser does.
        except Exception:
            return None
    return mapped if mapped.flags.c_contiguous else None


def open_npz(path: Path) -> PointCloud:
    """Read the points of an .npz file.

    Args:
        path: the file, with the array `points` (as in `open_npy`), if need be `colors` (uint8 [N, 3]); other arrays [N]
            become fields, and arrays of other shapes are passed over.

    Returns:
        The cloud, rows in the order of the array.

    Raises:
        InputError: the file cannot be read, holds pickled objects, or has no array `points`.
    """
    arrays = load_arrays(path)
    if not isinstance(arrays, dict):
        raise InputError(f"{path}: is no .npz archive; save it with numpy.savez, or rename it to .npy")
    if "points" not in arrays:
        names = ", ".join(arrays) or "none"
        raise InputError(f"{path}: has no array 'points', only: {names}; save it with numpy.savez(file, points=...)")
    return _cloud(arrays.pop("points"), path, arrays)


def load_arrays(file: Path) -> np.ndarray | dict[str, np.ndarray]:
    """Load the array of an .npy file or the arrays of an .npz file, whatever the file is called.

    Args:
        file: that `require_file` has seen.

    Raises:
        InputError: the file is damaged, or holds pickled objects.
    """
    try:
        return _loaded(file)
    # NumPy, zipfile and zlib raise at least eight kinds of exception on damaged files, MemoryError among them.
    except Exception as error:
        if "pickle" in str(error):
            raise InputError(
                f"{file}: is no NumPy file, or holds pickled Python objects, which are not read because they can run "
                "code; save plain numbers with numpy.save(file, array.astype(float))"
            ) from error
        raise InputError(
            f"{file}: NumPy cannot read it ({one_line(error)}); the file is damaged, save it again"
        ) from error


def load_archive(file: Path, remedy: str, names: Collection[str] | None = None) -> dict[str, np.ndarray]:
    """Load the arrays of an .npz file that gmmjax wrote.

    Args:
        file: that `require_file` has seen.
        remedy: what to do where the file is damaged.
        names: of the arrays; those that are not there are left out. None is all.

    Raises:
        InputError: the file is damaged, is no archive, or holds pickled objects.
    """
    try:
        loaded = _loaded(file, names)
        if not isinstance(loaded, dict):
            raise ValueError("it is a single array")
    except Exception as error:
        raise InputError(f"{file}: is no NPZ file of numbers ({one_line(error)}); {remedy}") from error
    return loaded


def _loaded(file: Path, names: Collection[str] | None = None) -> np.ndarray | dict[str, np.ndarray]:
    with file.open("rb") as stream, warnings.catch_warnings():
        # NumPy warns of headers of Python 2 and of numbers in them that no Python writes.
        warnings.simplefilter("ignore")
        loaded = np.load(stream, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return loaded
        members = {name: loaded[name] for name in loaded.files if names is None or name in names}
    # NumPy gives any other member as bytes.
    return {name: values for name, values in members.items() if isinstance(values, np.ndarray)}


def _check_points(points: np.ndarray, file: Path) -> None:
    shape = points.shape
    if points.dtype.kind not in "fiu":
        raise InputError(f"{file}: holds {points.dtype}, not real numbers; save points as float [N, 3]")
    if points.ndim not in (2, 3) or not 3 <= shape[-1] <= MAX_COLUMNS:
        hint = "; transpose it" if points.ndim == 2 and shape[0] == 3 else "; save points as float [N, 3]"
        raise InputError(f"{file}: the array has shape {list(shape)}, neither [N, 3] nor [H, W, 3]{hint}")


def _cloud(points: np.ndarray, file: Path, others: dict[str, np.ndarray]) -> PointCloud:
    _check_points(points, file)
    *grid, width = points.shape
    rows = points.reshape(-1, width)
    colors = others.pop("colors", None)
    fields = dict(zip(_further_columns(width), rows.T[3:], strict=True))
    for name, values in others.items():
        if values.dtype.kind in "fiub" and values.shape in (tuple(grid), (len(rows),)):
            fields[name] = values.reshape(-1)
    if colors is not None and colors.ndim == points.ndim:
        colors = colors.reshape(-1, colors.shape[-1])
    return PointCloud.from_rows(rows[:, :3], colors, fields, str(file))


def copied_part(values: np.ndarray, first: int, last: int) -> np.ndarray:
    """Copy some values of an array; of a memory map nothing else stays in memory, which would count as ours.

    Args:
        values: an array or a memory map.
        first: index of the first value.
        last: index behind the last one.
    """
    part = np.array(values[first:last])
    # The changes to a private map (mode "c") are in memory alone.
    if isinstance(values, np.memmap) and values.mode != "c" and hasattr(mmap, "MADV_DONTNEED"):
        values._mmap.madvise(mmap.MADV_DONTNEED)  # type: ignore[attr-defined]
    return part


def write_archive(file: IO[bytes], arrays: Mapping[str, np.ndarray], part: int = 1_000_000) -> None:
    """Write arrays as an uncompressed NPZ, some values at a time.

    Args:
        file: that is written to.
        arrays: of one axis, by name; memory maps are read as they are written.
        part: values that are in memory at a time.
    """
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                header = np.lib.format.header_data_from_array_1_0(values[:0])
                np.lib.format.write_array_header_1_0(entry, {**header, "shape": values.shape})
                for first in range(0, len(values), part):
                    entry.write(copied_part(values, first, first + part).tobytes())
