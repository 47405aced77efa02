"""One candidate with all that facts are measured from: its points, and what of both clouds surrounds them."""

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8
from scipy.spatial import ConvexHull, cKDTree

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.differences import DetectionLimits
from gmmjax.changes.evidence.continuation import Continuation
from gmmjax.changes.evidence.coverage_edge import ReferenceSurfaces
from gmmjax.changes.evidence.free_space import Sightlines
from gmmjax.geometry import LocalSurface, evenly_chosen, plane_surface


@dataclasses.dataclass(frozen=True)
class SurroundingsSettings:
    """What of both clouds surrounds a candidate. Lengths in spacings, where they say so.

    Attributes:
        reach: how far the surroundings go beyond three standard deviations of the candidate, in spacings. 0: small
            candidates have none.
        most_points: of the other cloud within reach that are looked at, evenly chosen: a bound on the time.
        contact: distance, in spacings, within which points are in contact. Smaller: the gaps between points separate
            what is adjacent.
        adjacent: distance, in spacings, within which points of other candidates are beside a candidate.
        least_around: number of points of the other cloud within reach, at least, for the directions in which they lie
            to say anything; of fewer there are none. 0: a single stray point is a direction.
        directions: number of directions, evenly spread over the sphere, that are looked into.
        neighbourhood: how far the neighbourhood goes beyond four standard deviations of the candidate, in spacings. 0:
            what surrounds a small candidate says nothing.
        within: standard deviations of a candidate along its axes, within which points of the other cloud are among its
            own. Large: the floor below a thing is among its points; 0: nothing is.
        farthest: distance to unchanged points, in spacings, at most: where there are none. Larger: the same.
        nearby: distance, in spacings, within which unchanged points tell the registration error at a candidate. Larger:
            it is that of the whole scan.
        opposite: distance along the surface of the other cloud, in its spacings there, within which it lies opposite a
            point. Larger: the rim of a hole lies opposite what is in the hole; 0: nothing does.
        undisplaced: number of the unchanged points next to a candidate that tell how far the whole surface is off
            there. Few: a displacement that thins out is taken for that of the whole surface.
        sure: offset, in registration errors and in standard deviations of the offset there, from which on a point is
            surely off a surface. 0: by whatever it is off.
        chunk: number of points that are compared with all planes of a hull at a time: what fits the cache. It does not
            change what is measured.
        posteriors: of the joint mixtures that are held at a time, points times restarts: a bound on the memory, which
            the largest candidate alone may exceed. It does not change what is measured.
    """

    reach: float = 10.0
    most_points: int = 4000
    contact: float = 3.0
    adjacent: float = 5.0
    least_around: int = 10
    directions: int = 32
    neighbourhood: float = 40.0
    within: float = 2.0
    farthest: float = 1000.0
    nearby: float = 25.0
    opposite: float = 1.5
    undisplaced: int = 400
    sure: float = 3.0
    chunk: int = 512
    posteriors: int = 4_000_000


class Excess(NamedTuple):
    """The posterior of the joint mixtures that the points of a candidate are of what only its cloud has.

    Attributes:
        mean: over its points and the restarts.
        of_restarts: the mean over its points, for each restart.
    """

    mean: float
    of_restarts: Float[np.ndarray, " r"]


class Displacements(NamedTuple):
    """How far points are off the surface of the other cloud.

    Attributes:
        vectors: from that surface to each point, along its normal, in the unit of the clouds.
        opposite: whether the surface lies opposite the point, and neither beside it nor farther off than a spacing.
    """

    vectors: Float[np.ndarray, "m 3"]
    opposite: Bool[np.ndarray, " m"]

    @classmethod
    def of(
        cls,
        points: Float[np.ndarray, "m 3"],
        surface: LocalSurface,
        limits: DetectionLimits,
        settings: SurroundingsSettings = SurroundingsSettings(),
    ) -> "Displacements":
        """How far some points are off a surface.

        Args:
            points: of one cloud.
            surface: of the other cloud.
            limits: of distances and offsets.
            settings: what lies opposite a point.
        """
        there = surface.nearest(points)
        heights, spacing = surface.heights(points, there), surface.spacing(there)
        opposite = heights.beside <= settings.opposite * spacing
        opposite &= np.abs(heights.above) <= limits.settings.opposite_height * spacing
        return cls(heights.above[:, None] * surface.normals[there], opposite)

    def sure(
        self, error: float | Float[np.ndarray, " m"], settings: SurroundingsSettings = SurroundingsSettings()
    ) -> Bool[np.ndarray, " m"]:
        """Which points are surely off the surface opposite them, to either side.

        Args:
            error: standard deviation of the offset of an unchanged surface, of each point or of all.
            settings: by how many errors a point is surely off.
        """
        return np.asarray(self.opposite & (np.linalg.norm(self.vectors, axis=1) > settings.sure * error))


class Areas(NamedTuple):
    """Areas of one cloud, those of its points: the square of their spacing.

    Attributes:
        differing: of all points that are of candidates.
        everything: of all points.
    """

    differing: float
    everything: float

    @classmethod
    def of(cls, labels: Int[np.ndarray, " n"], spacing: float | Float[np.ndarray, " n"]) -> "Areas":
        """The areas of a cloud.

        Args:
            labels: of each point -1, or the number of its candidate.
            spacing: of the points, at each or everywhere.
        """
        area = np.broadcast_to(np.asarray(spacing, float) ** 2, len(labels))
        return cls(float(area[labels >= 0].sum()), float(area.sum()))


@dataclasses.dataclass(frozen=True, eq=False)
class Surroundings:
    """What the candidates of one cloud have in common.

    Attributes:
        own: the candidates of the cloud, cut into pieces.
        clusters: of each point -1, or the number of the candidate that its piece was cut from.
        continuations: of each piece.
        reference: trees of the points of the cloud that are of no candidate, and of the other cloud.
        everything: tree of all points of the cloud.
        supports: whether each point is of a piece that a candidate of the other cloud stands on.
        opposite: tree of those of them that are of candidates.
        surface: of the other cloud.
        limits: of distances and offsets.
        areas: of the whole cloud, where only a part of it is here, too.
        sightlines: how surely the other survey observed each place to be empty; None: its views are not known.
        settings: what surrounds a candidate.
    """

    own: Candidates
    clusters: Int[np.ndarray, " n"]
    continuations: Mapping[int, Continuation]
    reference: ReferenceSurfaces
    everything: cKDTree
    supports: Bool[np.ndarray, " n"]
    opposite: cKDTree
    surface: LocalSurface
    limits: DetectionLimits
    areas: Areas
    sightlines: Sightlines | None = None
    settings: SurroundingsSettings = SurroundingsSettings()

    @property
    def unchanged(self) -> cKDTree:
        """Tree of the points of the cloud that are of no candidate."""
        return self.reference.unchanged

    @property
    def other(self) -> cKDTree:
        """Tree of the points of the other cloud."""
        return self.reference.other

    @functools.cached_property
    def differing(self) -> cKDTree:
        """Tree of the points of the cloud that are of candidates."""
        return cKDTree(self.own.points[self.own.labels >= 0])

    @functools.cached_property
    def in_free_space(self) -> cKDTree:
        """Tree of those of them in free space of the other survey; none where its views are not known."""
        free = np.zeros(len(self.own.labels), bool) if self.own.free is None else self.own.free
        return cKDTree(self.own.points[(self.own.labels >= 0) & free])

    @functools.cached_property
    def unchanged_offsets(self) -> Float[np.ndarray, " u"]:
        """Offset of each of these points."""
        return self.own.difference.offset[self.clusters < 0]

    @functools.cached_property
    def hull(self) -> Float[np.ndarray, "f 4"]:
        """The planes of the convex hull of the other cloud: normals outwards, and offsets."""
        # Joggled, so that a flat cloud has one, too.
        return np.asarray(ConvexHull(self.other.data, qhull_options="QJ").equations)

    @functools.cached_property
    def relative_distance(self) -> Float[np.ndarray, " n"]:
        """Distance of each point of the cloud to the other cloud, in its limit."""
        return np.asarray(self.own.difference.distance / self.limits.local_distance(self.own.difference))

    @functools.cached_property
    def relative_offset(self) -> Float[np.ndarray, " n"]:
        """Offset of each point, in its limit."""
        return np.asarray(self.limits.relative_offset(self.own.difference))

    @functools.cached_property
    def offset_errors(self) -> Float[np.ndarray, " n"]:
        """Standard deviation of the offset of an unchanged surface at each point."""
        return self.limits.offset_errors(self.own.difference)

    def displacements(self, points: Float[np.ndarray, "m 3"]) -> Displacements:
        """How far some points are off the surface of the other cloud."""
        return Displacements.of(points, self.surface, self.limits, self.settings)

    @functools.cached_property
    def excess(self) -> list[Excess]:
        """Of each piece."""
        found, posterior = list[Excess](), self.own.excess
        for pieces in self._handfuls(rows_of_pieces(self.own.labels)):
            together = posterior.together(np.concatenate(pieces))
            parts = np.split(together, np.cumsum([len(rows) for rows in pieces])[:-1])
            found += [Excess(float(part.mean()), part.mean(axis=0)) for part in parts]
        return found

    def _handfuls(self, pieces: list[Int[np.ndarray, " _"]]) -> Iterator[list[Int[np.ndarray, " _"]]]:
        """Pieces whose posteriors by all restarts are held at a time."""
        most = self.settings.posteriors // self.own.excess.restarts
        handful, points = list[Int[np.ndarray, " _"]](), 0
        for rows in pieces:
            if handful and points + len(rows) > most:
                yield handful
                handful, points = [], 0
            handful.append(rows)
            points += len(rows)
        if handful:
            yield handful


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
    def excess(self) -> "Excess":
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
        chosen = within[evenly_chosen(len(within), self.surroundings.settings.most_points)]
        relative = other.data[chosen] - self.centre
        return np.asarray(relative[np.linalg.norm(relative, axis=1) > 0])

    @property
    def count_within(self) -> float:
        """Number of points of the other cloud in its ellipsoid, whose axes have a spacing of width at least."""
        if not len(self.around):
            return 0.0
        deviations, axes = self._axes
        scaled = self.around @ axes / np.maximum(deviations, self.spacing / 2)
        inside = (scaled**2).sum(axis=1) < self.surroundings.settings.within**2
        return self.around_count * float(inside.mean())

    @functools.cached_property
    def directions(self) -> Float[np.ndarray, "k 3"]:
        """Unit directions of these points; none where there are too few."""
        if len(self.around) < self.surroundings.settings.least_around:
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
        sure = self.surroundings.settings.sure * self.surroundings.offset_errors[self.rows]
        return np.asarray(own.opposite & (to_one_side > sure))

    @property
    def _displacements_nearby(self) -> Displacements:
        """Of the unchanged points next to it."""
        unchanged = self.surroundings.unchanged
        count = min(self.surroundings.settings.undisplaced, unchanged.n)
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


def rows_of_pieces(labels: Int[np.ndarray, " n"]) -> list[Int[np.ndarray, " _"]]:
    """The points of each piece, in the order of their numbers.

    Args:
        labels: of each point -1, or the number of its piece.
    """
    order = np.argsort(labels, kind="stable")
    starts = np.searchsorted(labels[order], np.arange(labels.max(initial=-1) + 2))
    return [order[first:last] for first, last in itertools.pairwise(starts)]
