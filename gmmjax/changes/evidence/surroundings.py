"""What of both clouds surrounds the candidates of one of them."""

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import ConvexHull, cKDTree

from gmmjax.changes.candidates import Candidates
from gmmjax.changes.differences import DetectionLimits
from gmmjax.changes.evidence.continuation import Continuation
from gmmjax.changes.evidence.coverage_edge import ReferenceSurfaces
from gmmjax.changes.evidence.displacements import Displacements, DisplacementSettings
from gmmjax.changes.evidence.free_space import Sightlines
from gmmjax.geometry import LocalSurface


@dataclasses.dataclass(frozen=True)
class SurroundingsSettings:
    """What of both clouds surrounds a candidate. Lengths in spacings, where they say so.

    Attributes:
        reach: how far the surroundings go beyond three standard deviations of the candidate, in spacings. 0: small
            candidates have none.
        max_points: of the other cloud within reach that are looked at, evenly chosen: a bound on the time.
        contact: distance, in spacings, within which points are in contact. Smaller: the gaps between points separate
            what is adjacent.
        adjacent: distance, in spacings, within which points of other candidates are beside a candidate.
        min_around: number of points of the other cloud within reach, at least, for the directions in which they lie
            to say anything; of fewer there are none. 0: a single stray point is a direction.
        directions: number of directions, evenly spread over the sphere, that are looked into.
        neighbourhood: how far the neighbourhood goes beyond four standard deviations of the candidate, in spacings. 0:
            what surrounds a small candidate says nothing.
        interspersed: standard deviations of a candidate along its axes, within which points of the other cloud are
            among its own. Large: the floor below an object is among its points; 0: nothing is.
        farthest: distance to unchanged points, in spacings, at most: where there are none. Larger: the same.
        nearby: distance, in spacings, within which unchanged points tell the registration error at a candidate. Larger:
            it is that of the whole scan.
        displacements: how far points are off the surface of the other cloud.
        chunk: number of points that are compared with all planes of a hull at a time: what fits the cache. It does not
            change what is measured.
        posteriors: of the joint mixtures that are held at a time, points times restarts: a bound on the memory, which
            the largest candidate alone may exceed. It does not change what is measured.
    """

    reach: float = 10.0
    max_points: int = 4000
    contact: float = 3.0
    adjacent: float = 5.0
    min_around: int = 10
    directions: int = 32
    neighbourhood: float = 40.0
    interspersed: float = 2.0
    farthest: float = 1000.0
    nearby: float = 25.0
    displacements: DisplacementSettings = DisplacementSettings()
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
        """Tree of those of candidates in free space of the other survey; none where its views are not known."""
        free = np.zeros(len(self.own.labels), bool) if self.own.free is None else self.own.free
        return cKDTree(self.own.points[(self.own.labels >= 0) & free])

    @functools.cached_property
    def unchanged_offsets(self) -> Float[np.ndarray, " u"]:
        """Offset of each point of the cloud that is of no candidate."""
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
        return Displacements.of(points, self.surface, self.limits, self.settings.displacements)

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


def rows_of_pieces(labels: Int[np.ndarray, " n"]) -> list[Int[np.ndarray, " _"]]:
    """The points of each piece, in the order of their numbers.

    Args:
        labels: of each point -1, or the number of its piece.
    """
    order = np.argsort(labels, kind="stable")
    starts = np.searchsorted(labels[order], np.arange(labels.max(initial=-1) + 2))
    return [order[first:last] for first, last in itertools.pairwise(starts)]
