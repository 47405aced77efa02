"""Files of points that are opened without being read whole, and then read some rows at a time."""

import abc
import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int16, Int64, UInt8

from gmmjax.clouds.colors import ColorRange, color_bytes
from gmmjax.clouds.point_cloud import PointCloud, intensity_field
from gmmjax.clouds.source_file import SourceFile
from gmmjax.clouds.views import SensorViews
from gmmjax.errors import InputError, one_line

CHUNK_POINTS = 1_000_000
"""Points of a chunk where the caller says nothing: with all that is computed of them, some hundred megabytes."""


class Bounds(NamedTuple):
    """A box along the axes.

    Attributes:
        lower: its lowest coordinates.
        upper: its highest ones.
    """

    lower: Float64[np.ndarray, "3"]
    upper: Float64[np.ndarray, "3"]


class CloudChunk(NamedTuple):
    """Some points of a file, in its order.

    Attributes:
        points: coordinates in the world, all finite.
        rows: of the file, that the points are.
    """

    points: Float64[np.ndarray, "n 3"]
    rows: Int64[np.ndarray, " n"]


class RowBlock(NamedTuple):
    """Rows of a file as they are there, in its order.

    Attributes:
        points: coordinates in the world; NaN or infinite where a row has no position.
        columns: all other scalars by name, of either byte order.
        colors: red, green and blue as the file has them; None where it has none.
        scan: the scan of each point, counted from 0; None where all are of one.
        rows: their numbers; None: they follow the block before.
    """

    points: Float64[np.ndarray, "n 3"]
    columns: Mapping[str, np.ndarray] = {}
    colors: np.ndarray | None = None
    scan: Int16[np.ndarray, " n"] | None = None
    rows: Int64[np.ndarray, " n"] | None = None

    def part(self, place: slice | np.ndarray) -> "RowBlock":
        """Some of the rows."""
        columns = {name: values[place] for name, values in self.columns.items()}
        colors, scan, rows = (
            None if values is None else values[place] for values in (self.colors, self.scan, self.rows)
        )
        return RowBlock(self.points[place], columns, colors, scan, rows)


class Measures(NamedTuple):
    """Measures that only all points of a file tell.

    Attributes:
        points: how many rows have a position.
        colors: the range of their colours, where these are not bytes.
        whole: lowest and highest value of each column of whole numbers of 64 bits.
    """

    points: int
    colors: ColorRange
    whole: Mapping[str, tuple[int, int]]


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class CloudFile(abc.ABC):
    """A file of points that was opened; its points are read when they are asked for, as often as they are.

    Attributes:
        path: of the file, as it was given.
        source: the file as it was when it was opened. Where it is changed later, reading it is an error.
        count: its rows, among them those without a position.
        unit: as of `PointCloud`.
        crs: as of `PointCloud`.
        bounds: of the points, as the file declares it, which need not be right; None where it does not.
    """

    path: Path
    source: SourceFile
    count: int
    unit: str | None = None
    crs: str | None = None
    bounds: Bounds | None = None

    @property
    def scans(self) -> int:
        """Number of scans in the file."""
        return 1

    @abc.abstractmethod
    def blocks(self) -> Iterator[RowBlock]:
        """Yield all rows, some at a time.

        Raises:
            InputError: the file is damaged or cut off.
        """

    def views_of(self, blocks: Callable[[], Iterable[RowBlock]]) -> SensorViews | None:
        """Views of the sensor that the file states; None where it states none.

        Args:
            blocks: gives all rows that have a position, some at a time.
        """
        return None

    @functools.cached_property
    def views(self) -> SensorViews | None:
        """Views of the sensor that the file states; the file may have to be read for them, once."""
        return self.views_of(lambda: self._finite_blocks(CHUNK_POINTS))

    def row_blocks(self, size: int = CHUNK_POINTS) -> Iterator[RowBlock]:
        """Yield all rows with their numbers, at most `size` at a time.

        Args:
            size: rows; no result depends on it.

        Raises:
            InputError: the file is damaged, was changed since it was opened, or cannot be read; `size` is below 1.
        """
        if size < 1:
            raise InputError(f"size must be at least 1 point, not {size}; {CHUNK_POINTS} is usual")
        done = 0
        try:
            self.source.require_unchanged()
            for block in self.blocks():
                self.source.require_unchanged()
                if block.rows is None:
                    block = block._replace(rows=np.arange(done, done + len(block.points), dtype=np.int64))
                done += len(block.points)
                for start in range(0, len(block.points), size):
                    whole = len(block.points) <= size
                    yield block if whole else block.part(slice(start, start + size))
        except (OSError, MemoryError) as error:
            raise InputError(
                f"{self.path}: cannot be read ({one_line(error) or 'the memory is full'}); copy it to a local disk and "
                "try again"
            ) from error

    def _finite_blocks(self, size: int) -> Iterator[RowBlock]:
        """The rows that have a position, without the blocks that are empty then."""
        return (kept for block in self.row_blocks(size) if len((kept := finite_rows(block)).points))

    def chunks(self, size: int = CHUNK_POINTS) -> Iterator[CloudChunk]:
        """Yield the points that have a position, at most `size` at a time: those of `read_cloud`, bit for bit.

        Raises:
            InputError: as `row_blocks`.
        """
        for block in self._finite_blocks(size):
            assert block.rows is not None
            yield CloudChunk(block.points, block.rows)

    def clouds(self, size: int = CHUNK_POINTS) -> Iterator[PointCloud]:
        """Yield the points with colours and fields, at most `size` at a time; `rows` are those of the file.

        Raises:
            InputError: as `row_blocks`.
        """
        return map(self._cloud, self._finite_blocks(size))

    def colors_or_intensity(self, rows: Int64[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"] | np.ndarray | None:
        """Read the colours of some rows or, where the file has none, their intensity; None where it has neither.

        Args:
            rows: of the file, in any order, that have a position.

        Returns:
            Red, green and blue [n, 3], or the intensity [n].

        Raises:
            InputError: as `row_blocks`, or colours that are none.
        """
        order, limits = np.argsort(rows), ColorRange()
        wanted, parts = rows[order], list[np.ndarray]()
        for block in self.row_blocks():
            values = _colors_or_intensity(block)
            if values is None:
                return None
            assert block.rows is not None
            own = wanted[slice(*np.searchsorted(wanted, block.rows[[0, -1]] + [0, 1]))]
            parts.append(values[np.searchsorted(block.rows, own)])
            if block.colors is not None and block.colors.dtype != np.uint8:
                limits = limits.with_channels(block.colors)
        if not parts:
            return None
        found = np.concatenate(parts)
        found[order] = found.copy()
        return found if found.ndim == 1 else color_bytes(found, str(self.path), limits)

    @functools.cached_property
    def measures(self) -> Measures:
        """The measures of all points: the file is read for them, once."""
        points, colors = 0, ColorRange()
        whole: dict[str, tuple[int, int]] = {}
        for block in self.row_blocks():
            kept = finite_rows(block)
            points += len(kept.points)
            if block.colors is not None and block.colors.dtype != np.uint8:
                colors = colors.with_channels(block.colors)
            for name, values in kept.columns.items():
                if values.dtype.kind in "iu" and values.dtype.itemsize == 8 and values.size:
                    low, high = int(values.min()), int(values.max())
                    known = whole.get(name, (low, high))
                    whole[name] = min(low, known[0]), max(high, known[1])
        return Measures(points, colors, whole)

    def read(self) -> PointCloud:
        """Read all points.

        Raises:
            InputError: as `row_blocks`, or the memory does not hold them.
        """
        table: RowBlock | None = None
        done = 0
        for block in self.row_blocks():
            table = self._empty(block) if table is None else table
            place = slice(done, done + len(block.points))
            for whole, part in zip(_arrays(table), _arrays(block), strict=True):
                whole[place] = part
            done += len(block.points)
        points, columns, channels, *_ = table or RowBlock(np.empty((0, 3)))
        colors = None if channels is None else color_bytes(channels, str(self.path))
        cloud = PointCloud.from_rows(points, colors, columns, str(self.path))
        views = self.views_of(lambda: [RowBlock(cloud.points, cloud.fields, rows=cloud.rows)])
        return dataclasses.replace(cloud, views=views, unit=self.unit, crs=self.crs, file=self.source)

    def _empty(self, block: RowBlock) -> RowBlock:
        """Room for all rows, of the types of a block."""
        try:
            columns = {name: _room(values, self.count) for name, values in block.columns.items()}
            colors = None if block.colors is None else _room(block.colors, self.count)
            return RowBlock(_room(block.points, self.count), columns, colors)
        # NumPy's error where not even the number of bytes can be told.
        except (MemoryError, ValueError) as error:
            raise InputError(
                f"{self.path}: declares {self.count} points, more than the memory holds; the file is damaged, copy or "
                "export it again; or free some memory"
            ) from error

    def _cloud(self, block: RowBlock) -> PointCloud:
        assert block.rows is not None
        colors = block.colors
        if colors is not None:
            colors = color_bytes(colors, str(self.path), None if colors.dtype == np.uint8 else self.measures.colors)
        return PointCloud(
            block.points,
            block.rows,
            colors,
            {name: native(values) for name, values in block.columns.items()},
            source=str(self.path),
            unit=self.unit,
            crs=self.crs,
            file=self.source,
        )


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class WholeFile(CloudFile):
    """A file of a format that is read whole: text, archives and meshes, and whatever is compressed as a whole.

    Attributes:
        cloud: what was read from it.
    """

    cloud: PointCloud

    def views_of(self, blocks: Callable[[], Iterable[RowBlock]]) -> SensorViews | None:
        """Views of the sensor that the file states."""
        return self.cloud.views

    def blocks(self) -> Iterator[RowBlock]:
        """Yield all points, in one block."""
        yield RowBlock(self.cloud.points, self.cloud.fields, self.cloud.colors, rows=self.cloud.rows)

    def read(self) -> PointCloud:
        """The cloud that was read, with its file."""
        return dataclasses.replace(self.cloud, file=self.source)


def finite_rows(block: RowBlock) -> RowBlock:
    """Drop the rows without a position."""
    finite = np.isfinite(block.points)
    # Nearly always all are, and to ask for each row takes ten times as long.
    return block if finite.all() else block.part(np.flatnonzero(finite.all(axis=1)))


def native(values: np.ndarray) -> np.ndarray:
    """Make numbers contiguous, in the machine's byte order."""
    return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))


def _colors_or_intensity(block: RowBlock) -> np.ndarray | None:
    if block.colors is not None:
        return block.colors
    name = intensity_field(block.columns)
    return None if name is None else native(block.columns[name])


def _arrays(block: RowBlock) -> list[np.ndarray]:
    """All arrays that a cloud is made of."""
    return [block.points, *block.columns.values(), *([] if block.colors is None else [block.colors])]


def _room(values: np.ndarray, count: int) -> np.ndarray:
    """An empty array for the values of that many rows."""
    return np.empty((count, *values.shape[1:]), values.dtype.newbyteorder("="))
