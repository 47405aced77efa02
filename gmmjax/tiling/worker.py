"""The work of one process on a tile. Nothing that is imported here needs JAX: a task imports what it needs."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

from gmmjax.tiling.block_store import BlockStore
from gmmjax.tiling.records import Arrays, RecordPlace, write_record

BlockTask: TypeAlias = Callable[..., Arrays]
"""A function of a module that takes a store, a block, and plain further arguments."""

Tile: TypeAlias = tuple[int, ...]
"""The numbers of some blocks, ascending."""

# The store that a process asked for last stays open.
_opened = functools.lru_cache(maxsize=1)(BlockStore)


def compute_tile(
    store: Path, records: Path, task: BlockTask, arguments: tuple[Any, ...], tile: Tile
) -> list[RecordPlace]:
    """Compute each block of a tile, and append the results to a file of this worker's own.

    Args:
        store: folder of the store.
        records: folder for the results.
        task: what is computed.
        arguments: of the task.
        tile: the numbers of the blocks.
    """
    opened = _opened(store)
    return [write_record(records, number, task(opened, opened.tree.blocks[number], *arguments)) for number in tile]
