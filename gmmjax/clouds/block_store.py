"""The points of two clouds, block by block, with those in a margin around a block."""

import abc
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from gmmjax.clouds.blocks import Block, BlockTree
from gmmjax.clouds.placed_clouds import StoredPoints
from gmmjax.geometry import within_box
from gmmjax.pair import Pair, each


class BlockPoints(NamedTuple):
    """The points of a cloud in a block, in the order of their rows, and then those in the margin around it.

    The points in the margin are in the order of the blocks that they are in, and in each in the order of their rows.

    Attributes:
        points: coordinates relative to the offset.
        rows: of the cloud that they are from.
        inside: whether each is in the block itself; every point of a cloud is inside of one block.
    """

    points: Float64[np.ndarray, "n 3"]
    rows: Int64[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]


class AbstractBlockStore(abc.ABC):
    """The points of two clouds in the frame of the before cloud, block by block."""

    @property
    @abc.abstractmethod
    def tree(self) -> BlockTree:
        """The blocks."""

    @property
    @abc.abstractmethod
    def row_counts(self) -> Pair[int]:
        """The number of rows of either cloud, those without a position among them."""

    @abc.abstractmethod
    def inside(self, number: int) -> Pair[StoredPoints]:
        """The points in a block, in the order of their rows.

        Args:
            number: of the block.
        """

    @property
    def offset(self) -> Float64[np.ndarray, "3"]:
        """What is to be added to the coordinates, for the frame of the before cloud."""
        return self.tree.lattice.offset

    @functools.cached_property
    def blocks(self) -> Sequence[Block]:
        """All blocks, in the order of their numbers."""
        return [self.tree.block(number) for number in range(len(self.tree))]

    def points_of(self, block: Block, margin: float, most_around: int | None = None) -> Pair[BlockPoints]:
        """The points in a block, and those around it that are nearer to it than a margin along every axis.

        They are the same, in the same order, however the clouds were read.

        Args:
            block: one of the blocks.
            margin: around it, in the unit of the clouds.
            most_around: points of either cloud in the margin, at most, and at least 1: of more, every second, fourth,
                eighth, ... is taken. None: all of them.
        """
        lower, upper = block.lower - margin, block.lower + block.edge + margin
        around = Pair(_Around(most_around), _Around(most_around))
        for number in self.tree.near(block, margin):
            for own, points in zip(around, self.inside(int(number)), strict=True):
                own.add(points.part(within_box(points.points, lower, upper)))
        return each(lambda own, others: _with_margin((own, *others.parts)), self.inside(block.number), around)


class _Around:
    """Points of one cloud around a block: all of them, or every second, fourth, ... where there are too many.

    Attributes:
        parts: in the order of the blocks.
    """

    def __init__(self, most: int | None):
        self.parts: list[StoredPoints] = []
        self._most, self._step, self._passed = most, 1, 0

    def add(self, points: StoredPoints) -> None:
        """Takes the points of one more block."""
        self.parts.append(_every(self._step, points, first=-self._passed % self._step))
        self._passed += len(points.points)
        while self._most is not None and sum(len(own.points) for own in self.parts) > self._most:
            self._step *= 2
            together = StoredPoints(*(np.concatenate(own) for own in zip(*self.parts, strict=True)))
            self.parts = [_every(2, together)]


def _every(step: int, points: StoredPoints, first: int = 0) -> StoredPoints:
    """Every second, third, ... of some points; a slice would keep all of them in memory."""
    return points if step == 1 else points.part(np.arange(first, len(points.points), step))


def _with_margin(parts: tuple[StoredPoints, ...]) -> BlockPoints:
    points, rows = (np.concatenate(own) for own in zip(*parts, strict=True))
    return BlockPoints(points, rows, np.arange(len(points)) < len(parts[0].points))
