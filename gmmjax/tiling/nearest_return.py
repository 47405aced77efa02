"""The points of scans of any size that their sensors see first in each direction, block by block."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from gmmjax.changes import NAMES, NearestReturnSettings, nearest_return_at
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair
from gmmjax.tiling.block_store import BlockStore
from gmmjax.tiling.blocks import Block
from gmmjax.tiling.records import Arrays, BlockRecords


class Looks(NamedTuple):
    """Lines of sight to the points of a survey.

    Attributes:
        views: where it was taken from, relative to the offset.
        cell: edge of a cell of directions, degrees.
        step: which points are taken: every first, second, and so on.
    """

    views: SensorViews
    cell: float
    step: int

    @classmethod
    def of(cls, views: SensorViews, points: int, settings: NearestReturnSettings = NearestReturnSettings()) -> "Looks":
        """The looks of some views at a number of points."""
        return cls(views, settings.cell, settings.step(points, len(views)))


def block_nearest_returns(store: BlockStore, block: Block, looks: Pair[Looks | None]) -> Arrays:
    """The points of either cloud in a block that nothing in the block hides, a `BlockTask`.

    Args:
        store: of the block.
        block: one of the store's.
        looks: of both surveys; None: its views are not known.
    """
    found = {}
    for side, chunk, own in zip(NAMES, store.inside(block.number), looks, strict=True):
        points = chunk.points[:0] if own is None else chunk.points[:: own.step]
        found[side] = points if own is None else points[nearest_return_at(points, own.views, own.cell)]
    return found


def nearest_returns_of_blocks(records: BlockRecords) -> Pair[Float64[np.ndarray, "_ 3"]]:
    """The points of `block_nearest_returns` of all blocks, relative to the offset.

    Args:
        records: of the task.
    """
    values = [records.values(number) for number in records.numbers]
    return NAMES.map(lambda side: np.concatenate([own[side].astype(np.float64) for own in values]))
