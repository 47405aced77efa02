"""Whether two scanned objects can be one: what of the one lies on the other, and what contradicts it.

Two surveys seldom see the same sides of an object, so much of it may have no counterpart. It speaks against one object
only where the other survey must have seen it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64
from scipy.spatial import cKDTree

from gmmjax.changes.free_space import Observed, Survey, observation
from gmmjax.changes.local_difference import OTHER_NEIGHBOURS, OWN_NEIGHBOURS
from gmmjax.changes.neighbours import nearest_neighbours
from gmmjax.changes.planes import local_planes

# A point lies on a surface when it is off it by no more than so many standard deviations of local means.
ON_IT = 3.0
# And when it has a point of the surface within so many spacings.
BESIDE = 2.5
# A survey looked through a place when there is no surface of it within so many standard deviations of local means.
CLEAR = 6.5


class Agreement(NamedTuple):
    """How an object fits another one.

    Attributes:
        covered: share of its points that lie on the other.
        contradicted: share that does not, although the survey of the other must have seen it.
    """

    covered: float
    contradicted: float

    @property
    def share(self) -> float:
        """Share that is covered of what says anything."""
        return self.covered / max(self.covered + self.contradicted, np.finfo(np.float64).tiny)


def agreement(
    placed: Float64[np.ndarray, "n 3"], other: Float64[np.ndarray, "m 3"], survey: Survey, noise: float, tested: int
) -> Agreement:
    """How an object that was laid onto another one fits it.

    A point that does not lie on the other object, nor on anything else that its survey saw, contradicts when the survey
    looked through its place. It also contradicts when it is on or in front of the plane that the other object has
    nearest to it: where a surface was seen, so was what continues it, and what hides it. With views this is not held
    against a place that the survey did not observe.

    Args:
        placed: the one object, laid onto the other.
        other: the other object.
        survey: in which the other was seen.
        noise: standard deviation of the offset between local means of one surface.
        tested: at most so many points, evenly chosen.
    """
    own, target = cKDTree(placed), cKDTree(other)
    spacing = max(spacing_of(own), spacing_of(target))
    probes = evenly_chosen(placed, tested)
    means = placed[nearest_neighbours(own, probes, OWN_NEIGHBOURS)[1]].mean(axis=1)
    both = np.concatenate([placed, other])
    heights = _heights(means, target, (both.min(axis=0) + both.max(axis=0)) / 2)
    covered = _lies_on(probes, heights, target, noise, spacing)
    elsewhere = _lies_on(probes, _heights(means, survey.tree, probes.mean(axis=0)), survey.tree, noise, spacing)
    seen = heights > -ON_IT * noise
    if survey.views is not None:
        observed = observation(probes, survey, CLEAR * noise)
        seen = (seen & (observed != Observed.unobserved)) | (observed == Observed.free)
    return Agreement(float(covered.mean()), float((seen & ~covered & ~elsewhere).mean()))


def evenly_chosen(points: Float64[np.ndarray, "n 3"], size: int) -> Float64[np.ndarray, "m 3"]:
    """At most so many of the points, evenly spaced in their order."""
    return points[np.linspace(0, len(points) - 1, min(size, len(points))).astype(int)]


def spacing_of(tree: cKDTree) -> float:
    """Median distance to the nearest neighbour."""
    return float(np.median(nearest_neighbours(tree, tree.data, 2)[0][:, -1]))


def _heights(
    means: Float64[np.ndarray, "n 3"], surface: cKDTree, middle: Float64[np.ndarray, " 3"]
) -> Float[np.ndarray, " n"]:
    """How far each local mean is off the surface's plane there; positive away from the middle."""
    centres, normals, _ = local_planes(surface.data[nearest_neighbours(surface, means, OTHER_NEIGHBOURS)[1]])
    outwards = np.sign(((centres - middle) * normals).sum(axis=1))
    return np.asarray(((means - centres) * normals).sum(axis=1) * outwards)


def _lies_on(
    points: np.ndarray, heights: np.ndarray, surface: cKDTree, noise: float, spacing: float
) -> Bool[np.ndarray, " n"]:
    beside = np.isfinite(surface.query(points, distance_upper_bound=BESIDE * spacing)[0])
    return np.asarray(beside & (np.abs(heights) < ON_IT * noise))
