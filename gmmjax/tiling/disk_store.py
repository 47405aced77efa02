"""The points of two clouds on disk, block by block: what a file of any size is read from while it is compared.

Each cloud is one file of records, a point and its row, in the order of the blocks. Where each block begins is known
from the numbers of points before the first point is written, so that every chunk goes to its place at once, in memory
that does not grow with the clouds.
"""

import functools
import os
import threading
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from jaxtyping import Int64

from gmmjax.clouds import AbstractBlockStore, BlockTree, Lattice, PlacedClouds, StoredPoints, read_both
from gmmjax.errors import InputError
from gmmjax.pair import Pair, each
from gmmjax.tiling.folder import disk_errors, reserve, working_folder

_RECORD = np.dtype([("point", "<f8", (3,)), ("row", "<i8")])
_POINTS = Pair("before.points", "after.points")
_INDEX = "blocks.npz"
_SIDES = ("counts", "spacings", "extents")


class DiskBlockStore(AbstractBlockStore):
    """The points of two clouds on disk; opened by its folder, in any process."""

    def __init__(self, folder: Path, cached_points: int = 4_000_000):
        """Opens a store that `write_block_store` wrote.

        Args:
            folder: of the store.
            cached_points: of the blocks that were read last, which are kept in memory: blocks share their margins.
                0: each block is read again for each of its neighbours.

        Raises:
            InputError: there is no store.
        """
        self.folder = folder
        self._tree, self._row_counts = _read_index(folder)
        self._ends = self._tree.counts.map(np.cumsum)
        self._cache: OrderedDict[int, Pair[StoredPoints]] = OrderedDict()
        self._cached, self._most_cached = 0, cached_points
        self._lock = threading.Lock()

    @property
    def tree(self) -> BlockTree:
        """The blocks."""
        return self._tree

    @property
    def row_counts(self) -> Pair[int]:
        """The number of rows of either cloud."""
        return self._row_counts

    def inside(self, number: int) -> Pair[StoredPoints]:
        """The points in a block; see `AbstractBlockStore`.

        Raises:
            InputError: the disk fails.
        """
        # The workers of a cluster may be threads of one process.
        with self._lock:
            if number not in self._cache:
                with disk_errors(self.folder):
                    found = each(lambda *own: self._read(number, *own), _POINTS, self._tree.counts, self._ends)
                self._cache[number] = found
                self._cached += _size(found)
            self._cache.move_to_end(number)
            found = self._cache[number]
            while self._cached > self._most_cached:
                self._cached -= _size(self._cache.popitem(last=False)[1])
        return found

    def _read(
        self, number: int, name: str, counts: Int64[np.ndarray, " b"], ends: Int64[np.ndarray, " b"]
    ) -> StoredPoints:
        # Read, not mapped: pages of a mapped file count as memory of the process.
        count, end = int(counts[number]), int(ends[number])
        records = np.fromfile(self.folder / name, _RECORD, count, offset=(end - count) * _RECORD.itemsize)
        if len(records) < count:
            raise OSError(f"{name} was cut off")
        return StoredPoints(np.ascontiguousarray(records["point"]), np.ascontiguousarray(records["row"]))


@contextmanager
def temporary_block_store(
    clouds: PlacedClouds, tree: BlockTree, parent: str | os.PathLike[str] | None = None
) -> Iterator[DiskBlockStore]:
    """The points of two clouds in blocks on disk, removed when the block of code ends.

    Args:
        clouds: both.
        tree: their blocks, as of `tree_of`.
        parent: folder in which a temporary one is made, on a disk with room for 32 bytes a point; None: the system's
            folder for temporary files.

    Raises:
        InputError: as `write_block_store`, or the folder cannot be written.
    """
    with working_folder(parent) as folder:
        yield write_block_store(clouds, tree, folder)


def write_block_store(clouds: PlacedClouds, tree: BlockTree, folder: Path) -> DiskBlockStore:
    """Reads two clouds and writes their points block by block.

    Args:
        clouds: both.
        tree: their blocks, as of `tree_of`.
        folder: that is there.

    Raises:
        InputError: a file cannot be read or changed since its blocks were made, or the disk is full.
    """
    needed = sum(int(own.sum()) for own in tree.counts) * _RECORD.itemsize
    with disk_errors(folder, needed):
        _write_index(folder, tree, clouds.row_counts)
        writers = each(lambda name, counts: _Writer(folder / name, counts), _POINTS, tree.counts)

    def write(chunks: Iterator[StoredPoints], writer: _Writer) -> None:
        for chunk in chunks:
            numbers = tree.blocks_of(chunk.points) if tree.lattice.holds(chunk.points) else None
            with disk_errors(folder, needed):
                writer.add(chunk, numbers)
        writer.finish()

    try:
        read_both(write, clouds.chunks(tree.lattice), writers)
    finally:
        for writer in writers:
            writer.close()
    return DiskBlockStore(folder)


class _Writer:
    """The file of one cloud; each block has its place, and is filled from its beginning."""

    def __init__(self, path: Path, counts: Int64[np.ndarray, " b"]):
        self._next = np.cumsum(counts) - counts
        self._ends = np.cumsum(counts)
        self._file = path.open("xb")
        try:
            reserve(self._file.fileno(), int(self._ends[-1]) * _RECORD.itemsize)
        except BaseException:
            self.close()
            raise

    def add(self, chunk: StoredPoints, numbers: Int64[np.ndarray, " n"] | None) -> None:
        """Writes points behind those that are there, in the blocks of these numbers; None: not all are in one."""
        if numbers is None or (numbers < 0).any():
            raise _changed()
        order = np.argsort(numbers, kind="stable")
        records = np.empty(len(order), _RECORD)
        records["point"], records["row"] = chunk.points[order], chunk.rows[order]
        met, firsts, counts = np.unique(numbers[order], return_index=True, return_counts=True)
        if (self._next[met] + counts > self._ends[met]).any():
            raise _changed()
        for number, first, count in zip(met.tolist(), firsts.tolist(), counts.tolist(), strict=True):
            self._file.seek(int(self._next[number]) * _RECORD.itemsize)
            self._file.write(records[first : first + count].tobytes())
        self._file.flush()
        self._next[met] += counts

    def finish(self) -> None:
        """Tells when points are missing that were counted."""
        if (self._next < self._ends).any():
            raise _changed()

    def close(self) -> None:
        """Closes the file."""
        # What could not be written was said before.
        with suppress(OSError):
            self._file.close()


def _changed() -> InputError:
    return InputError("before, after: a file changed while it was read; start again when it is complete")


def _size(points: Pair[StoredPoints]) -> int:
    return sum(len(own.points) for own in points)


def _write_index(folder: Path, tree: BlockTree, row_counts: Pair[int]) -> None:
    sides = {f"{name}_{side}": getattr(getattr(tree, name), side) for name in _SIDES for side in ("before", "after")}
    np.savez(
        folder / _INDEX,
        offset=tree.lattice.offset,
        edge=tree.lattice.edge,
        finest=tree.finest,
        rows=list(row_counts),
        levels=tree.levels,
        codes=tree.codes,
        voxel_sizes=tree.voxel_sizes,
        **sides,
    )


def _read_index(folder: Path) -> tuple[BlockTree, Pair[int]]:
    try:
        with np.load(folder / _INDEX, allow_pickle=False) as index:
            values = dict(index)
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be read ({error.strerror}); all workers must see this folder by the same path"
        ) from error
    counts, spacings, extents = (Pair(values[f"{name}_before"], values[f"{name}_after"]) for name in _SIDES)
    lattice = Lattice(values["offset"], float(values["edge"]))
    levels, codes, voxel_sizes = (values[name] for name in ("levels", "codes", "voxel_sizes"))
    tree = BlockTree(lattice, int(values["finest"]), levels, codes, voxel_sizes, counts, spacings, extents)
    return tree, Pair(*map(int, values["rows"]))


@functools.lru_cache(maxsize=1)
def opened_store(folder: Path) -> DiskBlockStore:
    """The store of a folder; the one that a process asked for last stays open.

    Args:
        folder: of the store.
    """
    return DiskBlockStore(folder)
