"""Where an object is: its points in the frame of the series, and which places are one and the same."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from gmmjax.changes import Box
from gmmjax.geometry import MEAN_NEIGHBOURS, evenly_chosen, nearest_neighbours

# Points lie at each other up to this distance, in spacings of the place that has the larger one: as of detection, which
# sees no change below it. Smaller: noise and drift of the frames part what is one; larger: neighbours become one.
SPACINGS = 3.0
# Points of a place of which the spacing is measured, and whether it was observed.
PROBES = 64


@dataclasses.dataclass(frozen=True, eq=False)
class Place:
    """The points of a change in the frame of the series.

    Attributes:
        points: coordinates, at least one point.
        box: around all points of the change, also those that were not kept.
    """

    points: Float[np.ndarray, "n 3"]
    box: Box

    @functools.cached_property
    def tree(self) -> cKDTree:
        """Of the points."""
        return cKDTree(self.points)

    @functools.cached_property
    def probed(self) -> Float[np.ndarray, "m 3"]:
        """Some of the points, evenly chosen."""
        return self.points[evenly_chosen(len(self.points), PROBES)]

    @functools.cached_property
    def spacing(self) -> float:
        """Distance of neighbouring points: k points that fill a disc of radius r evenly are r sqrt(pi / k) apart."""
        distances, _ = nearest_neighbours(self.tree, self.probed, MEAN_NEIGHBOURS)
        radius = float(np.median(distances[:, -1]))
        return radius * float(np.sqrt(np.pi / distances.shape[1]))

    def shares(self, other: "Place") -> "Shares":
        """The shares of the points of two places that lie at points of the other."""
        reach = SPACINGS * max(self.spacing, other.spacing)
        return Shares(_share_within(self, other, reach), _share_within(other, self, reach))


class Shares(NamedTuple):
    """Of two places, the share of the points of each that lie at points of the other, 0 to 1."""

    own: float
    other: float

    @property
    def of_smaller(self) -> float:
        """The greater one: that of the place that lies within the other."""
        return max(self)

    @property
    def of_larger(self) -> float:
        """The lesser one: near 1 only where both have the same shape."""
        return min(self)

    @property
    def mean(self) -> float:
        """By which one place is preferred to another."""
        return sum(self) / 2


class Link(NamedTuple):
    """A known place and a new one that are the same.

    Attributes:
        known: index of the known place.
        new: index of the new one.
        overlap: share of the points of the smaller one that lie at points of the other, 0 to 1.
        assigned: whether the two were assigned to each other; else one of them is a further piece of the other.
    """

    known: int
    new: int
    overlap: float
    assigned: bool


def linked(known: Sequence[Place], new: Sequence[Place], least: float) -> list[Link]:
    """Which new places are known ones: one to one by the greatest overlap, and then the pieces that are left.

    A detector may report one object as two pieces, or two that touch as one. What is left by the assignment, of either
    side, is a piece of the place that it overlaps most.

    Args:
        known: places of objects.
        new: places of changes.
        least: share of the points of the smaller place; the link is made where more overlap.

    Returns:
        The links, those assigned first; each place is in one at most as the piece of another.
    """
    of_smaller, preferred = np.zeros((2, len(known), len(new)))
    for row, column in near(known, new):
        shares = known[row].shares(new[column])
        of_smaller[row, column], preferred[row, column] = shares.of_smaller, shares.mean
    same = of_smaller > least
    preferred = np.where(same, preferred, 0.0)
    rows, columns = linear_sum_assignment(preferred, maximize=True)
    pairs = [(row, column) for row, column in zip(rows.tolist(), columns.tolist(), strict=True) if same[row, column]]
    pieces = _pieces(preferred, same, pairs)
    return [
        Link(row, column, float(of_smaller[row, column]), assigned)
        for these, assigned in ((pairs, True), (pieces, False))
        for row, column in these
    ]


def near(known: Sequence[Place], new: Sequence[Place]) -> list[tuple[int, int]]:
    """The known and the new places whose points may lie at each other, by their boxes along the axes."""
    if not known or not new:
        return []
    (lower, upper, spacing), (other_lower, other_upper, other_spacing) = _bounds(known), _bounds(new)
    gaps = np.maximum(lower[:, None] - other_upper, other_lower - upper[:, None]).max(axis=2)
    reach = SPACINGS * np.maximum(spacing[:, None], other_spacing)
    return [(int(row), int(column)) for row, column in np.argwhere(gaps <= reach)]


def _bounds(places: Sequence[Place]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Least and greatest coordinates, and spacing, of each place."""
    trees = [place.tree for place in places]
    spacings = np.array([place.spacing for place in places])
    return np.stack([tree.mins for tree in trees]), np.stack([tree.maxes for tree in trees]), spacings


def _pieces(
    preferred: Float[np.ndarray, "k n"], same: Bool[np.ndarray, "k n"], pairs: Sequence[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Of the known and the new places without a partner those that overlap one that has one."""
    rows, columns = {row for row, _ in pairs}, {column for _, column in pairs}
    found = []
    for row in sorted(set(np.flatnonzero(same.any(axis=1)).tolist()) - rows):
        found.append((row, int(np.argmax(preferred[row]))))
    for column in sorted(set(np.flatnonzero(same.any(axis=0)).tolist()) - columns):
        found.append((int(np.argmax(preferred[:, column])), column))
    return found


def _share_within(place: Place, other: Place, reach: float) -> float:
    distances, _ = other.tree.query(place.points, distance_upper_bound=np.nextafter(reach, np.inf))
    return float(np.isfinite(distances).mean())
