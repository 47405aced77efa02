"""Places of objects: their points in the frame of the series, and the test that two places are the same."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from gmmjax.batch.comparison import Coverage
from gmmjax.changes import Box
from gmmjax.geometry import MEAN_NEIGHBOURS, evenly_chosen, nearest_neighbours, transformed

# Points lie at each other up to this distance, in spacings of the place that has the larger one: as of detection, which
# sees no change below it. Smaller: noise and drift of the frames part what is one; larger: neighbours become one.
SPACINGS = 3.0
# Points of a place of which the spacing is measured, and whether it was observed.
PROBES = 64
# A statement about a place holds if it holds for more than half of its points.
MAJORITY = 0.5


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
        """Search tree of the points."""
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

    def shares(self, other: "Place") -> tuple[float, float]:
        """The shares of the points of two places that lie at points of the other, the lesser one first.

        The greater one is near 1 where one place lies within the other, the lesser one where both have one shape.
        """
        reach = SPACINGS * max(self.spacing, other.spacing)
        own, others = sorted((_share_within(self, other, reach), _share_within(other, self, reach)))
        return own, others


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


def linked(known: Sequence[Place], new: Sequence[Place]) -> list[Link]:
    """Match new places with known ones: most points of the smaller one lie at the other.

    They are assigned one to one by the greatest overlap, and then the pieces that are left: a detector may report one
    object as two pieces, or two that touch as one. What is left by the assignment, of either side, is a piece of the
    place that it overlaps most.

    Args:
        known: places of objects.
        new: places of changes.

    Returns:
        The links, those assigned first; each place is in one at most as the piece of another.
    """
    overlap, preferred = np.zeros((2, len(known), len(new)))
    for row, column in _near(known, new):
        shares = known[row].shares(new[column])
        if max(shares) > MAJORITY:
            overlap[row, column], preferred[row, column] = max(shares), sum(shares) / 2
    rows, columns = linear_sum_assignment(preferred, maximize=True)
    pairs = [(row, column) for row, column in zip(rows.tolist(), columns.tolist(), strict=True) if overlap[row, column]]
    pieces = _pieces(preferred, pairs)
    return [
        Link(row, column, float(overlap[row, column]), assigned)
        for these, assigned in ((pairs, True), (pieces, False))
        for row, column in these
    ]


def of_same_shape(place: Place, known: Sequence[Place]) -> tuple[int | None, float]:
    """The known place that is most like a new one, most of the points of both at the other, and the greater share."""
    shares = {row: known[row].shares(place) for row, _ in _near(known, [place])}
    best = max(shares, key=lambda row: shares[row][0], default=None)
    if best is None or shares[best][0] <= MAJORITY:
        return None, 0.0
    return best, shares[best][1]


def not_observed(places: Sequence[Place], coverage: Coverage, frame: Float[np.ndarray, "4 4"]) -> list[bool]:
    """Mask of the places that a survey did not observe: the nearest points of the other cloud mostly were not.

    Args:
        places: in the frame of the series.
        coverage: of the other cloud by the survey.
        frame: rigid transform of the coverage into the frame of the series.
    """
    if not places or not len(coverage.points):
        return [False] * len(places)
    chosen = [place.probed for place in places]
    nearest = cKDTree(transformed(coverage.points, frame)).query(np.concatenate(chosen))[1]
    hidden = np.split(coverage.unobserved[nearest], np.cumsum([len(points) for points in chosen])[:-1])
    return [bool(own.mean() > MAJORITY) for own in hidden]


def _near(known: Sequence[Place], new: Sequence[Place]) -> list[tuple[int, int]]:
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


def _pieces(preferred: Float[np.ndarray, "k n"], pairs: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The known and the new places without a partner that overlap one that has one."""
    rows, columns = {row for row, _ in pairs}, {column for _, column in pairs}
    same: Bool[np.ndarray, "k n"] = preferred > 0
    found = []
    for row in sorted(set(np.flatnonzero(same.any(axis=1)).tolist()) - rows):
        found.append((row, int(np.argmax(preferred[row]))))
    for column in sorted(set(np.flatnonzero(same.any(axis=0)).tolist()) - columns):
        found.append((int(np.argmax(preferred[:, column])), column))
    return found


def _share_within(place: Place, other: Place, reach: float) -> float:
    distances, _ = other.tree.query(place.points, distance_upper_bound=np.nextafter(reach, np.inf))
    return float(np.isfinite(distances).mean())
