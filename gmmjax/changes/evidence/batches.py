"""Which candidates are examined together: as many as the clouds around them fit into memory."""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from gmmjax.changes.candidates import Candidates
from gmmjax.clouds import voxel_grid
from gmmjax.geometry import within_reach
from gmmjax.pair import Pair, each


class Batch(NamedTuple):
    """Candidates of one resolution that are examined together.

    Attributes:
        numbers: of the candidates of either cloud.
        rows: of the points of either cloud within reach.
        tree: of a few places for all of their points that are near each other.
        reach: distance from these places, within which the clouds have the resolution of the candidates.
    """

    numbers: Pair[list[int]]
    rows: Pair[Int[np.ndarray, " _"]]
    tree: cKDTree
    reach: float

    @classmethod
    def of(cls, numbers: Pair[list[int]], candidates: Pair[Candidates], reach: float) -> "Batch":
        """The batch of some candidates, at least one.

        Args:
            numbers: of these.
            candidates: of both clouds.
            reach: distance from them.
        """
        places = np.concatenate(
            [*each(lambda own, chosen: own.points[np.isin(own.labels, chosen)], candidates, numbers)]
        )
        tree = cKDTree(voxel_grid(places, reach / 8).points)
        rows = candidates.map(lambda own: np.flatnonzero(within_reach(tree, own.points, reach)))
        return cls(numbers, rows, tree, reach)

    def within(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Which points are within reach."""
        return within_reach(self.tree, points, self.reach)


def batches_of(
    numbers: Pair[list[int]],
    candidates: Pair[Candidates],
    shares: Pair[Float[np.ndarray, " _"]],
    reach: float,
    max_points: int,
) -> Iterator[Batch]:
    """Candidates in batches, each of which has no more points of either cloud within its reach, unless it is one.

    A batch that has more is halved along its longest axis: what is examined together depends on nothing but the place
    of the candidates.

    Args:
        numbers: of the candidates, at least one.
        candidates: of both clouds.
        shares: how much of a point each point of these is where they are examined.
        reach: distance from them.
        max_points: of either cloud within reach.
    """
    batch = Batch.of(numbers, candidates, reach)
    points = each(lambda own, near: float(own[near].sum()), shares, batch.rows)
    if max(points) <= max_points or sum(numbers.map(len)) == 1:
        yield batch
        return
    del batch
    for half in _halves(numbers, candidates):
        yield from batches_of(half, candidates, shares, reach, max_points)


def _halves(numbers: Pair[list[int]], candidates: Pair[Candidates]) -> list[Pair[list[int]]]:
    """The candidates on either side of the middle one along the longest axis of their centres."""
    centres = np.concatenate([*each(_centres, candidates, numbers)])
    order = np.argsort(centres[:, np.argmax(np.ptp(centres, axis=0))], kind="stable")
    lower = np.zeros(len(centres), bool)
    lower[order[: len(order) // 2]] = True
    first = len(numbers.before)

    def half(sides: Bool[np.ndarray, " n"]) -> Pair[list[int]]:
        chosen = Pair(sides[:first], sides[first:])
        return each(lambda own, which: list(itertools.compress(own, which)), numbers, chosen)

    return [half(lower), half(~lower)]


def _centres(own: Candidates, numbers: list[int]) -> Float[np.ndarray, "n 3"]:
    """The mean of the points of each of some candidates."""
    means = [own.points[own.labels == number].mean(axis=0) for number in numbers]
    return np.array(means).reshape(-1, 3)
