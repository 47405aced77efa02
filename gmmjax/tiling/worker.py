"""What a worker does with a tile. Neither this module nor what it imports needs JAX: a task imports what it needs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

from gmmjax.tiling.disk_store import opened_store
from gmmjax.tiling.records import BlockResult, RecordPlace, write_record
from gmmjax.tiling.tiles import Tile

BlockTask: TypeAlias = Callable[..., BlockResult]
"""A function of a module that takes a store, a block, and plain further arguments."""


def compute_tile(
    store: Path, records: Path, task: BlockTask, arguments: tuple[Any, ...], tile: Tile
) -> list[RecordPlace]:
    """What a worker does with a tile: computes each block, and appends the result to a file of its own.

    Args:
        store: folder of the store.
        records: folder for the results.
        task: what is computed.
        arguments: of the task.
        tile: the numbers of the blocks.
    """
    opened = opened_store(store)
    return [write_record(records, number, task(opened, opened.tree.block(number), *arguments)) for number in tile]
