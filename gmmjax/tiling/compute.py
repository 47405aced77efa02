"""Computes all blocks of a store, tile by tile, on many workers.

What is computed of a block is a `BlockTask`: a function of a module, so that a worker finds it by its name, which takes
the store, the block and any further arguments, and returns a `BlockResult`:

    def heights(store, block, margin):
        points = store.points_of(block, margin)
        inside = points.map(lambda own: own.points[own.inside])
        rows = inside.map(lambda own: {"height": own[:, 2] + store.offset[2]})
        return BlockResult({"points": np.array([len(own) for own in inside])}, rows)

    clouds = PlacedClouds(Pair(open_cloud("before.las"), open_cloud("after.las")), transform)
    with temporary_block_store(clouds, tree_of(clouds)) as store:
        columns = columns_of(store, {"height": np.float64(np.nan)})
        records = compute_blocks(store, heights, (0.5,), columns=columns)
        records[7].values["points"]                        # of block 7
        columns.before.column("height")                    # of all rows of before.las

A task sees nothing but the points of its block and of the margin around it, in an order of their own, so that its
result is the same bit for bit whatever the tiles and the workers are. A stage over many blocks reads the records in the
order of the blocks.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from gmmjax.batch import AbstractPool, Workers, died
from gmmjax.errors import ComputationError
from gmmjax.pair import Pair, each
from gmmjax.tiling.disk_store import DiskBlockStore
from gmmjax.tiling.records import BlockRecords, BlockResult, RecordPlace
from gmmjax.tiling.row_columns import FilledInBatches, RowColumns
from gmmjax.tiling.tiles import Tile, TileSettings, tiles_of
from gmmjax.tiling.worker import BlockTask, compute_tile

logger = logging.getLogger(__name__)


def columns_of(store: DiskBlockStore, missing: Mapping[str, np.generic]) -> Pair[RowColumns]:
    """Columns for the rows of both clouds, in the folder of their store.

    Args:
        store: of the clouds.
        missing: the value of rows that are in no block, such as those without a position, by the name of the column,
            whose type it gives.

    Raises:
        InputError: the disk is full.
    """
    folder = _new_folder(store.folder, "columns")
    return each(
        lambda side, count: RowColumns(folder / side, count, missing), Pair("before", "after"), store.row_counts
    )


def compute_blocks(
    store: DiskBlockStore,
    task: BlockTask,
    arguments: Sequence[Any] = (),
    *,
    columns: Pair[RowColumns] | None = None,
    tile_size: float | None = None,
    workers: Workers | AbstractPool = Workers(),
    progress: Callable[[str, float], None] | None = None,
    settings: TileSettings = TileSettings(),
) -> BlockRecords:
    """The results of a task for all blocks of a store, the same whatever the tiles and the workers are.

    A tile whose worker dies is computed again, when nothing else runs. A script that calls it needs
    `if __name__ == "__main__":`, as for every function that starts processes.

    Args:
        store: of the blocks.
        task: what is computed of each, in another process.
        arguments: of the task, after store and block.
        columns: that take what the task says of the rows; None: it is in the records only.
        tile_size: edge of a tile, in the unit of the clouds; None: tiles of about as many points each.
        workers: where tiles are computed; a pool is left open, unless the computation fails.
        progress: called with a message and the share of the points that are done.
        settings: of the tiles.

    Raises:
        InputError: a tile size below ten point spacings, or the disk is full.
        ComputationError: a worker died twice with the same tile, or there are no workers any more.
        Exception: what the task raises, once.
    """
    tiles = tiles_of(store.tree, tile_size, settings)
    folder = _new_folder(store.folder, "records")
    records = BlockRecords(folder)
    sizes = store.tree.counts.before + store.tree.counts.after
    logger.info("%d blocks in %d tiles", len(store.tree), len(tiles))
    done, filling = 0, None if columns is None else columns.map(FilledInBatches)
    for places in _results(tiles, (store.folder, folder, task, tuple(arguments)), workers):
        for place in places:
            records.add(place)
            if filling is not None:
                _fill(filling, store, records[place.number], place.number)
            done += int(sizes[place.number])
        if progress is not None:
            progress(f"{len(records)} of {len(store.tree)} blocks", done / max(int(sizes.sum()), 1))
    if filling is not None:
        filling.map(FilledInBatches.flush)
    return records


def _fill(filling: Pair[FilledInBatches], store: DiskBlockStore, result: BlockResult, number: int) -> None:
    for own, inside, values in zip(filling, store.inside(number), result.rows, strict=True):
        own.fill(inside.rows, values)


def _new_folder(parent: Path, name: str) -> Path:
    number = sum(1 for path in parent.glob(f"{name}-*"))
    folder = parent / f"{name}-{number}"
    folder.mkdir()
    return folder


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
        """Hands out tiles while there is room; whether anything is being computed."""
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
        """Keeps a tile whose worker died for later; whatever else happened ends the computation."""
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
                "smaller blocks (BlockSettings.most_points)"
            ) from error
        logger.warning("a worker process died; its tile is computed again")
        self._suspects.append(tile)
