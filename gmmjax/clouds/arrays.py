"""Reading clouds from NumPy's .npy and .npz files, never from pickles."""

import dataclasses
import math
import mmap
import os
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from gmmjax.clouds.cloud_file import CloudFile, RowBlock
from gmmjax.clouds.coordinates import as_points
from gmmjax.clouds.files import require_file
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.records import stored_records
from gmmjax.clouds.source_file import SourceFile
from gmmjax.errors import InputError, one_line

MOST_COLUMNS = 64
"""More columns than this are a transposed array rather than scalars of a point."""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class NpyFile(CloudFile):
    """An .npy file of numbers [N, columns], or of [H, W, columns] row by row.

    Attributes:
        dtype: of the numbers.
        columns: how many a point has.
        offset: bytes before them.
    """

    dtype: np.dtype
    columns: int
    offset: int

    def blocks(self) -> Iterator[RowBlock]:
        """All points, some at a time.

        Raises:
            InputError: the file is cut off.
        """
        row_type = np.dtype((np.void, self.columns * self.dtype.itemsize))
        for rows in stored_records(self.path, self.offset, row_type, self.count):
            table = rows.view(self.dtype).reshape(len(rows), self.columns)
            points = as_points(table[:, :3], f"{self.path}: points")
            yield RowBlock(points, {f"column_{index}": table[:, index] for index in range(3, self.columns)})


def open_npy(path: str | os.PathLike[str]) -> NpyFile | PointCloud:
    """The points of an .npy file.

    Args:
        path: the file: numbers [N, 3] or more columns (`column_3`, `column_4`, ... become fields), or an ordered cloud
            [H, W, 3], which is flattened row by row.

    Returns:
        The file, of which the header is read; or, where the numbers lie column by column (Fortran's order), its points.

    Raises:
        InputError: the file cannot be read, holds pickled objects, or has another shape.
    """
    file = require_file(path)
    written = SourceFile.of(file)
    layout = _array_layout(file)
    if layout is not None:
        shape, dtype, offset = layout
        count = math.prod(shape[:-1])
        if offset + count * shape[-1] * dtype.itemsize <= written.size:
            return NpyFile(path=file, source=written, count=count, dtype=dtype, columns=shape[-1], offset=offset)
    # NumPy says what is wrong with all others.
    loaded = load_arrays(file)
    if isinstance(loaded, dict):
        raise InputError(f"{file}: is an .npz archive; rename it to .npz")
    return _cloud(loaded, file, {})


def _array_layout(file: Path) -> tuple[tuple[int, ...], np.dtype, int] | None:
    """Shape, type and offset of an array of points that lie row by row; None where the header is of nothing such."""
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    with file.open("rb") as stream, warnings.catch_warnings():
        # NumPy warns of headers of Python 2 and of numbers in them that no Python writes.
        warnings.simplefilter("ignore")
        try:
            shape, by_column, dtype = readers[np.lib.format.read_magic(stream)](stream)
        # A damaged header may raise whatever Python's parser does.
        except Exception:
            return None
        usual = (
            dtype.kind in "fiu"
            and not by_column
            and len(shape) in (2, 3)
            and all(isinstance(size, int) for size in shape)
        )
        if not usual or min(shape) < 0 or not 3 <= shape[-1] <= MOST_COLUMNS:
            return None
        return shape, dtype, stream.tell()


def read_npz(path: str | os.PathLike[str]) -> PointCloud:
    """The points of an .npz file.

    Args:
        path: the file, with the array `points` (as in `open_npy`), if need be `colors` (uint8 [N, 3]); other arrays [N]
            become fields, and arrays of other shapes are passed over.

    Returns:
        The cloud, rows in the order of the array.

    Raises:
        InputError: the file cannot be read, holds pickled objects, or has no array `points`.
    """
    file = require_file(path)
    arrays = load_arrays(file)
    if not isinstance(arrays, dict):
        raise InputError(f"{file}: is no .npz archive; save it with numpy.savez, or rename it to .npy")
    if "points" not in arrays:
        names = ", ".join(arrays) or "none"
        raise InputError(f"{file}: has no array 'points', only: {names}; save it with numpy.savez(file, points=...)")
    return _cloud(arrays.pop("points"), file, arrays)


def load_arrays(file: Path) -> np.ndarray | dict[str, np.ndarray]:
    """The array of an .npy file or the arrays of an .npz file, whatever the file is called.

    Args:
        file: that `require_file` has seen.

    Raises:
        InputError: the file is damaged, or holds pickled objects.
    """
    try:
        with _loaded(file) as loaded:
            return loaded if isinstance(loaded, np.ndarray) else _members(loaded, loaded.files)
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


def load_archive(file: Path, remedy: str, names: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """The arrays of an .npz file that gmmjax wrote.

    Args:
        file: that `require_file` has seen.
        remedy: what to do where the file is damaged.
        names: of the arrays; those that are not there are left out. None is all.

    Raises:
        InputError: the file is damaged, is no archive, or holds pickled objects.
    """
    try:
        with _loaded(file) as loaded:
            if isinstance(loaded, np.ndarray):
                raise ValueError("it is a single array")
            return _members(loaded, loaded.files if names is None else [name for name in names if name in loaded])
    except Exception as error:
        raise InputError(f"{file}: is no NPZ file of numbers ({one_line(error)}); {remedy}") from error


@contextmanager
def _loaded(file: Path) -> Iterator[np.ndarray | np.lib.npyio.NpzFile]:
    with file.open("rb") as stream, warnings.catch_warnings():
        # NumPy warns of headers of Python 2 and of numbers in them that no Python writes.
        warnings.simplefilter("ignore")
        loaded = np.load(stream, allow_pickle=False)
        yield loaded


def _members(archive: np.lib.npyio.NpzFile, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays among the members: NumPy gives any other member as bytes."""
    members = {name: archive[name] for name in names}
    return {name: values for name, values in members.items() if isinstance(values, np.ndarray)}


def _cloud(points: np.ndarray, file: Path, others: dict[str, np.ndarray]) -> PointCloud:
    shape = points.shape
    if points.dtype.kind not in "fiu":
        raise InputError(f"{file}: holds {points.dtype}, not real numbers; save points as float [N, 3]")
    if points.ndim not in (2, 3) or not 3 <= shape[-1] <= MOST_COLUMNS:
        hint = "; transpose it" if points.ndim == 2 and shape[0] == 3 else "; save points as float [N, 3]"
        raise InputError(f"{file}: the array has shape {list(shape)}, neither [N, 3] nor [H, W, 3]{hint}")
    rows = points.reshape(-1, shape[-1])
    grid = shape[:-1]
    colors = others.pop("colors", None)
    fields = {f"column_{index}": rows[:, index] for index in range(3, shape[-1])}
    fields |= {name: values.reshape(-1) for name, values in others.items() if _is_scalar(values, grid)}
    if colors is not None and colors.ndim == points.ndim:
        colors = colors.reshape(-1, colors.shape[-1])
    return PointCloud.from_rows(rows[:, :3], colors, fields, str(file))


def _is_scalar(values: np.ndarray, grid: tuple[int, ...]) -> bool:
    return values.dtype.kind in "fiub" and values.shape in (grid, (int(np.prod(grid)),))


def copied_part(values: np.ndarray, first: int, last: int) -> np.ndarray:
    """Some values of an array in memory; of a memory map nothing else stays there, which would count as ours.

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
    """Writes arrays as an uncompressed NPZ, some values at a time.

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
