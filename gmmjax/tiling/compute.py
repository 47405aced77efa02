"""Compute all blocks of a store, tile by tile, on many workers.

What is computed of a block is a `BlockTask`: a function of a module, so that a worker finds it by its name, which takes
the store, the block and any further arguments, and returns arrays by name:

    def heights(store, block, margin):
        points = store.points_around(block, margin, most=1000)
        return {"mean": np.array([own[:, 2].mean() for own in points])}

    records = compute_blocks(store, heights, (0.5,))
    records.values(7)["mean"]  # of block 7

A task sees nothing but the points of its block and of the margin around it, in an order of their own, so that its
result is the same bit for bit whatever the tiles and the workers are. Tiles, the blocks that a worker takes at a time,
bound its memory and nothing else. A stage over many blocks reads the records in the order of the blocks.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from queue import SimpleQueue
from typing import Any

import numpy as np

from gmmjax.batch import AbstractPool, Workers, died
from gmmjax.errors import ComputationError, InputError
from gmmjax.tiling.block_store import BlockStore
from gmmjax.tiling.blocks import BlockTree
from gmmjax.tiling.records import BlockRecords, RecordPlace
from gmmjax.tiling.worker import BlockTask, Tile, compute_tile

logger = logging.getLogger(__name__)

# Points of both clouds in a tile, where no size is given. Fewer: messages take time; many: workers have nothing to do
# while others compute the last tiles.
TILE_POINTS = 2.5e5
# Edge of a tile in point spacings, at least: below, every tile is margin.
MIN_SPACINGS = 10.0


def tiles_of(tree: BlockTree, tile_size: float | None = None) -> list[Tile]:
    """The tiles of two clouds, each block in one of them.

    Args:
        tree: the blocks.
        tile_size: edge of a tile, in the unit of the clouds: a tile has the blocks whose centres are in it. None:
            a tile has consecutive blocks.

    Raises:
        InputError: a tile size that is not positive and finite, or below ten point spacings.
    """
    if tile_size is None:
        points = np.cumsum(tree.counts.before + tree.counts.after)
        keys = (points // TILE_POINTS)[:, None]
    else:
        _check_tile_size(tile_size, tree)
        keys = (tree.lowers + tree.edges[:, None] / 2) // tile_size
    _, first, tile = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(tile.ravel(), kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(tile.ravel()))[:-1])
    # In the order of the blocks, so that tiles that follow each other are mostly adjacent.
    return [tuple(parts[number].tolist()) for number in np.argsort(first)]


def _check_tile_size(tile_size: float, tree: BlockTree) -> None:
    if not 0 < tile_size < np.inf:
        raise InputError(f"tile_size={tile_size} must be positive and finite, in the unit of the scans")
    least = MIN_SPACINGS * float(np.nanmax(list(tree.spacing)))
    if tile_size < least:
        raise InputError(
            f"tile_size={tile_size:g} is below {MIN_SPACINGS:g} point spacings of the sparser scan; give at least "
            f"{1.005 * least:.3g}, or leave it out"
        )


def compute_blocks(
    store: BlockStore,
    task: BlockTask,
    arguments: Sequence[Any] = (),
    *,
    tile_size: float | None = None,
    workers: Workers | AbstractPool = Workers(),
    progress: Callable[[str, float], None] | None = None,
) -> BlockRecords:
    """The results of a task for all blocks of a store, the same whatever the tiles and the workers are.

    A tile whose worker dies is computed again, when nothing else runs. A script that calls it needs
    `if __name__ == "__main__":`, as for every function that starts processes.

    Args:
        store: of the blocks.
        task: what is computed of each, in another process.
        arguments: of the task, after store and block.
        tile_size: edge of a tile, in the unit of the clouds; None: tiles of about as many points each.
        workers: where tiles are computed; a pool is left open, unless the computation fails.
        progress: called with a message and the share of the points that are done.

    Raises:
        InputError: a tile size below ten point spacings, or the disk is full.
        ComputationError: a worker died twice with the same tile, or there are no workers any more.
        Exception: what the task raises, once.
    """
    tiles = tiles_of(store.tree, tile_size)
    folder = store.folder / f"records-{sum(1 for _ in store.folder.glob('records-*'))}"
    folder.mkdir()
    records = BlockRecords(folder)
    sizes = store.tree.counts.before + store.tree.counts.after
    logger.info("%d blocks in %d tiles", len(store.tree), len(tiles))
    done = 0
    for places in _results(tiles, (store.folder, folder, task, tuple(arguments)), workers):
        for place in places:
            records.add(place)
            done += int(sizes[place.number])
        if progress is not None:
            progress(f"{len(records)} of {len(store.tree)} blocks", done / max(int(sizes.sum()), 1))
    return records


def _results(tiles: list[Tile], call: tuple[Any, ...], workers: Workers | AbstractPool) -> Iterator[list[RecordPlace]]:
    """The results of tiles as they are done."""
    pool = workers if isinstance(workers, AbstractPool) else workers.pool(len(tiles), share_cores=False)
    driver = _Driver(tiles, call, pool)
    at_once = True
    try:
        yield from driver.results()
        at_once = False
    finally:
        if at_once or pool is not workers:
            pool.stop(at_once=at_once)
        # Nobody writes any more when the folder is removed.
        wait(driver.running, timeout=10)


class _Driver:
    """The state of a computation: the tiles that wait, that are computed, and that a worker died with."""

    def __init__(self, tiles: list[Tile], call: tuple[Any, ...], pool: AbstractPool):
        self._waiting, self._suspects = deque(tiles), deque[Tile]()
        self._call, self._pool = call, pool
        self._done: SimpleQueue[Future[Any]] = SimpleQueue()
        self._alone = False
        self.running: dict[Future[Any], Tile] = {}

    def results(self) -> Iterator[list[RecordPlace]]:
        while self._hand_out():
            future = self._done.get()
            tile = self.running.pop(future)
            found: list[RecordPlace] = []
            try:
                found = future.result()
            # A future that was cancelled, by a scheduler that has gone, is no `Exception`.
            except BaseException as error:
                self._after_death(tile, error)
            self._alone = False
            # Before anything is made of the result: the worker does not wait for that.
            self._hand_out()
            yield found

    def _hand_out(self) -> bool:
        """Hand out tiles while there is room; true where anything is being computed."""
        while self._waiting and not self._alone and len(self.running) < self._pool.capacity:
            self._submit(self._waiting.popleft())
        if not self.running and self._suspects:
            self._alone = True
            self._submit(self._suspects.popleft())
        return bool(self.running)

    def _submit(self, tile: Tile) -> None:
        future = self._pool.submit(compute_tile, *self._call, tile)
        self.running[future] = tile
        future.add_done_callback(self._done.put)

    def _after_death(self, tile: Tile, error: BaseException) -> None:
        """Keep a tile whose worker died for later; whatever else happened ends the computation."""
        if isinstance(error, KeyboardInterrupt | SystemExit):
            raise error
        if (lost := self._pool.lost(error)) is not None:
            raise lost from error
        if not died(error):
            raise error
        if self._alone:
            raise ComputationError(
                "a worker process died twice with the same tile, the second time with nothing else running: most "
                "likely there is too little memory, or the system ended the process; free some memory, or have "
                "smaller blocks (TiledDetectionSettings.max_points)"
            ) from error
        logger.warning("a worker process died; its tile is computed again")
        self._suspects.append(tile)
