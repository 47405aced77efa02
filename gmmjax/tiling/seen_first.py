"""The points of scans of any size that their sensors see first in each direction, block by block."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from gmmjax.changes import NAMES, SeenFirstSettings, seen_first_at
from gmmjax.clouds import AbstractBlockStore, Block, SensorViews
from gmmjax.pair import Pair, each
from gmmjax.tiling.records import BlockRecords, BlockResult


class Looks(NamedTuple):
    """How the points of a survey are looked at.

    Attributes:
        views: where it was taken from, relative to the offset.
        cell: edge of a cell of directions, degrees.
        step: which points are taken: every first, second, and so on.
    """

    views: SensorViews
    cell: float
    step: int

    @classmethod
    def of(cls, views: SensorViews, points: int, settings: SeenFirstSettings = SeenFirstSettings()) -> "Looks":
        """The looks of some views at a number of points."""
        return cls(views, settings.cell, settings.step(points, len(views)))


def block_seen_first(store: AbstractBlockStore, block: Block, looks: Pair[Looks | None]) -> BlockResult:
    """The points of a block that nothing in the block hides, a `BlockTask`: its values are these of either cloud.

    Args:
        store: of the block.
        block: one of the store's.
        looks: of both surveys; None: its views are not known.
    """

    def of_cloud(points: Float64[np.ndarray, "n 3"], own: Looks | None) -> Float64[np.ndarray, "m 3"]:
        if own is None:
            return points[:0]
        taken = points[:: own.step]
        return taken[seen_first_at(taken, own.views, own.cell)]

    inside = store.inside(block.number).map(lambda own: own.points)
    found = each(of_cloud, inside, looks)
    return BlockResult(dict(zip(NAMES, found, strict=True)), Pair({}, {}))


def seen_first_of_blocks(records: BlockRecords) -> Pair[Float64[np.ndarray, "_ 3"]]:
    """The points of `block_seen_first` of all blocks, relative to the offset.

    Args:
        records: of the task.
    """
    values = [records.values(number) for number in records.numbers]
    return NAMES.map(lambda side: np.concatenate([own[side].astype(np.float64) for own in values]))
