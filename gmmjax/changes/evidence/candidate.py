"""One candidate with all that facts are measured from: its points, and what of both clouds surrounds them."""

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float, Int, Int8
from scipy.spatial import cKDTree

from gmmjax.changes.evidence.continuation import Continuation
from gmmjax.changes.evidence.displacements import Displacements
from gmmjax.changes.evidence.free_space import Sightlines
from gmmjax.changes.evidence.surroundings import Excess, Surroundings, rows_of_pieces
from gmmjax.geometry import evenly_chosen, plane_surface


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """One piece of a candidate in its surroundings; what is computed from them is cached.

    Attributes:
        rows: of its points in the cloud.
        number: of the piece.
        surroundings: of all candidates of the cloud.
    """

    rows: Int[np.ndarray, " m"]
    number: int
    surroundings: Surroundings

    @property
    def spacing(self) -> float:
        """Of neighbouring points, in the sparser cloud."""
        return self.surroundings.limits.spacing

    @functools.cached_property
    def points(self) -> Float[np.ndarray, "m 3"]:
        """Its points."""
        return self.surroundings.own.points[self.rows]

    @property
    def area(self) -> float:
        """That of its points, in the square of the unit of the clouds."""
        return len(self.rows) * self.spacing**2

    @functools.cached_property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Mean of its points."""
        return np.asarray(self.points.mean(axis=0))

    @functools.cached_property
    def _axes(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
        variances, axes = np.linalg.eigh(np.cov(self.points.T, bias=True))
        return np.sqrt(np.maximum(variances, 0.0)), axes

    @property
    def deviations(self) -> Float[np.ndarray, "3"]:
        """Standard deviations of its points along their principal axes, the least first, in spacings."""
        return np.asarray(self._axes[0] / self.spacing)

    @property
    def normal(self) -> Float[np.ndarray, "3"]:
        """Principal axis along which its points vary least."""
        return np.asarray(self._axes[1][:, 0])

    @property
    def continuation(self) -> Continuation:
        """How it continues the surfaces beside it."""
        return self.surroundings.continuations[self.number]

    @property
    def relative_distance(self) -> Float[np.ndarray, " m"]:
        """Distance of its points to the other cloud, in the distance that is surely a change."""
        return self.surroundings.relative_distance[self.rows]

    @property
    def relative_offset(self) -> Float[np.ndarray, " m"]:
        """Offset of its points from the other cloud's surface, in the offset that is surely a change."""
        return self.surroundings.relative_offset[self.rows]

    @property
    def excess(self) -> Excess:
        """The posterior that its points are of what only its cloud has."""
        return self.surroundings.excess[self.number]

    @property
    def observed(self) -> Int8[np.ndarray, " m"] | None:
        """What the other survey observed at its points, where its views are known."""
        observed = self.surroundings.own.observed
        return None if observed is None else observed[self.rows]

    @property
    def sightlines(self) -> Sightlines:
        """How surely the other survey, whose views are known, observed its points' places to be empty."""
        of_cloud = self.surroundings.sightlines
        assert of_cloud is not None
        return Sightlines(*(values[self.rows] for values in of_cloud))

    @functools.cached_property
    def to_unchanged(self) -> Float[np.ndarray, " m"]:
        """Distance of its points to the nearest point of its cloud that is of no candidate, in spacings."""
        distances = self.surroundings.unchanged.query(self.points)[0] / self.spacing
        return np.asarray(np.minimum(distances, self.surroundings.settings.farthest))

    @functools.cached_property
    def to_other(self) -> Float[np.ndarray, " m"]:
        """Distance of its points to the other cloud, in the larger of the spacings of both there."""
        difference = self.surroundings.own.difference
        spacing = np.maximum(difference.spacing[self.rows], self.spacing)
        return np.asarray(difference.distance[self.rows] / spacing)

    def beside(self, tree: cKDTree) -> Bool[np.ndarray, " m"]:
        """Which of its points are beside a point of a tree."""
        reach = self.surroundings.settings.adjacent * self.spacing
        return np.isfinite(tree.query(self.points, distance_upper_bound=reach)[0])

    def count_beside(self, tree: cKDTree) -> int:
        """Number of the points of a tree around it, up to where they are beside it."""
        reach = (2 * float(np.linalg.norm(self.deviations)) + self.surroundings.settings.adjacent) * self.spacing
        return int(tree.query_ball_point(self.centre, reach, return_length=True))

    @property
    def _reach(self) -> float:
        return float(3 * np.linalg.norm(self.deviations) + self.surroundings.settings.reach) * self.spacing

    def count_in_neighbourhood(self, tree: cKDTree) -> int:
        """Number of the points of a tree in its neighbourhood."""
        around = self.surroundings
        radius = (4 * float(np.linalg.norm(self.deviations)) + around.settings.neighbourhood) * self.spacing
        return int(tree.query_ball_point(self.centre, radius, return_length=True))

    @functools.cached_property
    def around_count(self) -> int:
        """Number of points of the other cloud within reach."""
        return int(self.surroundings.other.query_ball_point(self.centre, self._reach, return_length=True))

    @functools.cached_property
    def around(self) -> Float[np.ndarray, "k 3"]:
        """Points of the other cloud within reach, relative to the centre."""
        other = self.surroundings.other
        within = np.sort(np.array(other.query_ball_point(self.centre, self._reach), int))
        chosen = within[evenly_chosen(len(within), self.surroundings.settings.max_points)]
        relative = other.data[chosen] - self.centre
        return np.asarray(relative[np.linalg.norm(relative, axis=1) > 0])

    @property
    def interspersed_count(self) -> float:
        """Number of points of the other cloud in its ellipsoid, whose axes have a spacing of width at least."""
        if not len(self.around):
            return 0.0
        deviations, axes = self._axes
        scaled = self.around @ axes / np.maximum(deviations, self.spacing / 2)
        inside = (scaled**2).sum(axis=1) < self.surroundings.settings.interspersed**2
        return self.around_count * float(inside.mean())

    @functools.cached_property
    def directions(self) -> Float[np.ndarray, "k 3"]:
        """Unit directions of these points; none where there are too few."""
        if len(self.around) < self.surroundings.settings.min_around:
            return np.empty((0, 3))
        return np.asarray(self.around / np.linalg.norm(self.around, axis=1, keepdims=True))

    @functools.cached_property
    def beyond_hull(self) -> Float[np.ndarray, " m"]:
        """How far its points are outside of the convex hull of the other cloud, in spacings; negative inside."""
        planes, chunk = self.surroundings.hull, self.surroundings.settings.chunk
        parts = [
            (self.points[first : first + chunk] @ planes[:, :3].T + planes[:, 3]).max(axis=1)
            for first in range(0, len(self.points), chunk)
        ]
        return np.asarray(np.concatenate(parts) / self.spacing)

    @functools.cached_property
    def roughness(self) -> float:
        """Standard deviation of its points from the planes through their neighbours, the median, in spacings."""
        return plane_surface(self.points).thickness / self.spacing

    @functools.cached_property
    def offsets_nearby(self) -> Float[np.ndarray, " k"]:
        """Offsets of the unchanged points of its cloud nearby."""
        around = self.surroundings
        radius = 2 * float(np.linalg.norm(self.deviations)) * self.spacing + around.settings.nearby * self.spacing
        return np.asarray(around.unchanged_offsets[around.unchanged.query_ball_point(self.centre, radius)])

    @functools.cached_property
    def displaced(self) -> Bool[np.ndarray, " m"]:
        """Which of its points are surely off a surface of the other cloud that lies opposite them, all to one side.

        What they are off is compared with what the unchanged points next to it are: a registration that is off by the
        same everywhere displaces nothing.
        """
        own, nearby = self.surroundings.displacements(self.points), self._displacements_nearby
        if not own.opposite.any():
            return own.opposite
        of_all = nearby.vectors[nearby.opposite].mean(axis=0) if nearby.opposite.any() else np.zeros(3)
        vectors = own.vectors - of_all
        mean = vectors[own.opposite].mean(axis=0)
        to_one_side = vectors @ (mean / max(float(np.linalg.norm(mean)), np.finfo(float).tiny))
        sure = self.surroundings.settings.displacements.sure * self.surroundings.offset_errors[self.rows]
        return np.asarray(own.opposite & (to_one_side > sure))

    @property
    def _displacements_nearby(self) -> Displacements:
        """Of the unchanged points next to it."""
        unchanged = self.surroundings.unchanged
        count = min(self.surroundings.settings.displacements.undisplaced, unchanged.n)
        nearest = unchanged.query(self.centre, range(1, count + 1))[1] if count else np.zeros(0, int)
        return self.surroundings.displacements(np.asarray(unchanged.data)[nearest])

    @property
    def cluster_rows(self) -> Int[np.ndarray, " c"]:
        """The points of the candidate that it was cut from."""
        clusters = self.surroundings.clusters
        return np.flatnonzero(clusters == clusters[self.rows[0]])


def candidates_in(surroundings: Surroundings) -> list[Candidate]:
    """All candidates of a cloud, in the order of their numbers."""
    pieces = rows_of_pieces(surroundings.own.labels)
    return [Candidate(rows, number, surroundings) for number, rows in enumerate(pieces)]
