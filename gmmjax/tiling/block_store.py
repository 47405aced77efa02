"""The points of two clouds on disk, block by block.

Each cloud is one file of records, a point and its row, in the order of the blocks. Where each block begins is known
from the numbers of points before the first point is written, so that every chunk goes to its place at once, in memory
that does not grow with the clouds.
"""

import functools
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.clouds import CloudChunk
from gmmjax.errors import InputError
from gmmjax.geometry import within_box
from gmmjax.pair import Pair, each
from gmmjax.tiling.blocks import Block, BlockTree
from gmmjax.tiling.disk import disk_errors, reserve
from gmmjax.tiling.placed_clouds import Lattice, PlacedClouds, file_changed, read_both

# Of the blocks that were read last, which are kept in memory: blocks share their margins. Fewer: each is read again for
# its neighbours; more: memory of every worker, 32 bytes each.
CACHED_POINTS = 4_000_000

_RECORD = np.dtype([("point", "<f8", (3,)), ("row", "<i8")])
_POINTS = Pair("before.points", "after.points")
_INDEX = "blocks.npz"


class BlockStore:
    """The points of two clouds on disk; opened by its folder, in any process.

    Attributes:
        folder: of the store.
        tree: the blocks.
        row_counts: number of rows of either cloud, those without a position among them.
    """

    def __init__(self, folder: Path):
        """Open a store that `write_block_store` wrote.

        Raises:
            InputError: there is no store.
        """
        self.folder = folder
        self.tree, self.row_counts = _read_index(folder)
        self._ends = self.tree.counts.map(np.cumsum)
        self._cache: OrderedDict[int, Pair[CloudChunk]] = OrderedDict()
        self._cached = 0
        self._lock = threading.Lock()

    @property
    def offset(self) -> Float64[np.ndarray, "3"]:
        """Origin of the coordinates, in the frame of the before cloud."""
        return self.tree.lattice.offset

    def inside(self, number: int) -> Pair[CloudChunk]:
        """The points in a block, relative to the offset, in the order of their rows.

        Args:
            number: of the block.

        Raises:
            InputError: the disk fails.
        """
        # The workers of a cluster may be threads of one process.
        with self._lock:
            if number not in self._cache:
                with disk_errors(self.folder):
                    found = each(functools.partial(self._read, number), _POINTS, self.tree.counts, self._ends)
                self._cache[number] = found
                self._cached += _size(found)
            self._cache.move_to_end(number)
            found = self._cache[number]
            while self._cached > CACHED_POINTS:
                self._cached -= _size(self._cache.popitem(last=False)[1])
        return found

    def points_around(self, block: Block, margin: float, most: int) -> Pair[Float64[np.ndarray, "_ 3"]]:
        """The points in a block, and then those in a margin around it; the same however the clouds were read.

        Args:
            block: one of the tree's.
            margin: around it along every axis, in the unit of the clouds.
            most: points of either cloud in the margin, at least 1: of more, every second, fourth, eighth, ... is taken.
        """
        around = Pair(_Thinned(most), _Thinned(most))
        for number in self.tree.near(block, margin):
            for own, (points, _) in zip(around, self.inside(int(number)), strict=True):
                own.add(points[within_box(points, *block.grown(margin))])
        return each(lambda own, others: np.concatenate([own.points, *others.parts]), self.inside(block.number), around)

    def _read(
        self, number: int, name: str, counts: Int64[np.ndarray, " b"], ends: Int64[np.ndarray, " b"]
    ) -> CloudChunk:
        # Read, not mapped: pages of a mapped file count as memory of the process.
        count, end = int(counts[number]), int(ends[number])
        records = np.fromfile(self.folder / name, _RECORD, count, offset=(end - count) * _RECORD.itemsize)
        if len(records) < count:
            raise OSError(f"{name} was cut off")
        return CloudChunk(np.ascontiguousarray(records["point"]), np.ascontiguousarray(records["row"]))


class _Thinned:
    """Points in parts: all of them, or every second, fourth, ... where there are too many."""

    def __init__(self, most: int):
        self.parts: list[Float64[np.ndarray, "_ 3"]] = []
        self._most, self._step, self._passed = most, 1, 0

    def add(self, points: Float64[np.ndarray, "n 3"]) -> None:
        """Take one more part."""
        # Copied: a slice would keep all of them in memory.
        self.parts.append(points[-self._passed % self._step :: self._step].copy())
        self._passed += len(points)
        while sum(map(len, self.parts)) > self._most:
            self._step *= 2
            self.parts = [np.concatenate(self.parts)[::2].copy()]


def write_block_store(clouds: PlacedClouds, tree: BlockTree, folder: Path) -> BlockStore:
    """Read two clouds and write their points block by block.

    Args:
        clouds: both.
        tree: their blocks, as of `tree_of`.
        folder: that is there.

    Raises:
        InputError: a file cannot be read or changed since its blocks were made, or the disk is full.
    """
    needed = sum(int(own.sum()) for own in tree.counts) * _RECORD.itemsize
    with ExitStack() as opened:
        with disk_errors(folder, needed):
            _write_index(folder, tree, clouds.row_counts)
            writers = each(lambda *own: opened.enter_context(closing(_Writer(folder, *own))), _POINTS, tree.counts)
        read_both(functools.partial(_write, tree, needed), clouds.chunks(), writers)
    return BlockStore(folder)


class _Writer:
    """The file of one cloud; each block has its place, and is filled from its beginning."""

    def __init__(self, folder: Path, name: str, counts: Int64[np.ndarray, " b"]):
        self.folder = folder
        self._next = np.cumsum(counts) - counts
        self._ends = np.cumsum(counts)
        self._file = (folder / name).open("xb")
        try:
            reserve(self._file.fileno(), int(self._ends[-1]) * _RECORD.itemsize)
        except BaseException:
            self.close()
            raise

    def add(self, chunk: CloudChunk, numbers: Int64[np.ndarray, " n"]) -> None:
        """Write points behind those that are there, in the blocks of these numbers."""
        if (numbers < 0).any():
            raise file_changed()
        order = np.argsort(numbers, kind="stable")
        records = np.empty(len(order), _RECORD)
        records["point"], records["row"] = chunk.points[order], chunk.rows[order]
        met, firsts, counts = np.unique(numbers[order], return_index=True, return_counts=True)
        if (self._next[met] + counts > self._ends[met]).any():
            raise file_changed()
        for number, first, count in zip(met.tolist(), firsts.tolist(), counts.tolist(), strict=True):
            self._file.seek(int(self._next[number]) * _RECORD.itemsize)
            self._file.write(records[first : first + count].tobytes())
        self._file.flush()
        self._next[met] += counts

    def require_whole(self) -> None:
        """Check that no point is missing that was counted."""
        if (self._next < self._ends).any():
            raise file_changed()

    def close(self) -> None:
        """Close the file."""
        # What could not be written was said before.
        with suppress(OSError):
            self._file.close()


def _write(tree: BlockTree, needed: int, chunks: Iterator[CloudChunk], writer: _Writer) -> None:
    for chunk in chunks:
        numbers = tree.blocks_of(chunk.points)
        with disk_errors(writer.folder, needed):
            writer.add(chunk, numbers)
    writer.require_whole()


def _size(points: Pair[CloudChunk]) -> int:
    return sum(len(own.points) for own in points)


def _write_index(folder: Path, tree: BlockTree, row_counts: Pair[int]) -> None:
    np.savez(
        folder / _INDEX,
        offset=tree.lattice.offset,
        edge=tree.lattice.edge,
        finest=tree.finest,
        rows=list(row_counts),
        levels=tree.levels,
        codes=tree.codes,
        counts=list(tree.counts),
        spacing=list(tree.spacing),
    )


def _read_index(folder: Path) -> tuple[BlockTree, Pair[int]]:
    try:
        with np.load(folder / _INDEX, allow_pickle=False) as index:
            values = dict(index)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be read ({error.strerror}); all workers must see this folder by the same path"
        ) from error
    lattice = Lattice(values["offset"], float(values["edge"]))
    counts, spacing = Pair(*values["counts"]), Pair(*map(float, values["spacing"]))
    tree = BlockTree(lattice, int(values["finest"]), values["levels"], values["codes"], counts, spacing)
    return tree, Pair(*map(int, values["rows"]))
