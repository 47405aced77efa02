"""Changes of surface scans: clusters of points that the other cloud has not, where the other survey looked."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8
from scipy.spatial import cKDTree

from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.evidence.free_space import Observed, Survey, observation
from gmmjax.changes.differences import DifferenceScale, LocalDifference
from gmmjax.geometry.density_clusters import density_clusters
from gmmjax.changes.evidence.support_planes import supports
from gmmjax.changes.evidence.continuation import unobserved_points

# A point is surely changed this far from the other cloud: in spacings of either cloud, in usual distances, in the
# thickness of the other surface there; and this far off its plane, in standard deviations of usual offsets.
SURE_SPACINGS = 3.0
SURE_DISTANCES = 3.0
SURE_THICKNESS = 4.0
SURE_OFFSETS = 7.0
# Below this share of the sure distance nothing is said.
FIRST_DISTANCE = 0.3
# An offset of this share of the sure one is evidence of a change where the other survey saw the surface.
THIN_OFFSET = 0.8
# A cluster holds points changed with the threshold's probability; it is a change when so many of them are changed with
# this one, a tenfold excess.
CORE_PROBABILITY = 0.9
SMALLEST_CORE = 20
# Clusters: points within so many spacings of each other, with so many neighbours each.
CLUSTER_RADIUS = 5.0
CLUSTER_NEIGHBOURS = 8
# A cluster takes in points that reach the threshold within so many of these radii.
GROWTH = 2.0
# With views: at least so many points of a change, so much of what was observed of it, and so much of all of it, lie
# where the other survey saw that there was nothing.
LEAST_FREE = 10
LEAST_FREE_SHARE = 0.5
LEAST_FREE_OF_ALL = 0.1
# Of a thin change, which is empty only by its offset, so much of all of it: the rims of half seen objects are off, too.
LEAST_THIN_OF_ALL = 0.35
# Without views: a segment that continues unchanged surfaces with more than this share of its points is none.
MOST_CONTINUED = 0.6
# An unchanged surface is at most this share of the sure offset apart in the two clouds.
SAME_SURFACE = 0.5
# A part of a segment is judged by itself when it has so many points and so much of the segment.
SMALLEST_PIECE = 100
SHARE_OF_PIECE = 0.15


class SurfaceCloud(NamedTuple):
    """One cloud of a pair with what is known of its points.

    Attributes:
        points: at the working resolution.
        difference: of each to the other cloud.
        excess: for each restart the posterior of the joint mixture that the point is extra.
    """

    points: Float[np.ndarray, "n 3"]
    difference: LocalDifference
    excess: Float[np.ndarray, "r n"]


class SurfaceScales(NamedTuple):
    """What distances mean in a pair of scans.

    Attributes:
        spacing: of neighbouring points.
        distance: how far from the other cloud a point is surely changed, where that is as dense as usual.
        offset: how far off the other cloud's plane.
    """

    spacing: float
    distance: float
    offset: float

    @classmethod
    def of(cls, spacing: float, scale: DifferenceScale) -> "SurfaceScales":
        """The scales of a pair with this spacing and these usual differences."""
        offset = SURE_OFFSETS * scale.offset
        return cls(spacing, max(SURE_SPACINGS * spacing, SURE_DISTANCES * scale.distance, offset), offset)

    def sure_offset(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The sure offset of each point, more where its neighbourhood is noisier."""
        return np.maximum(self.offset, SURE_OFFSETS * difference.noise)

    def sure_distance(self, difference: LocalDifference) -> Float[np.ndarray, " n"]:
        """The sure distance of each point, more where the other cloud is sparser or thicker."""
        local = np.maximum(SURE_SPACINGS * difference.spacing, SURE_THICKNESS * difference.thickness)
        return np.maximum(self.distance, local)


class SurfaceSegments(NamedTuple):
    """The changes of one cloud.

    Attributes:
        labels: -1, or the number of the segment.
        probability: for each restart, that the point is changed; 0 where nothing is known.
        unobserved: whether the other survey did not see the point's place.
    """

    labels: Int[np.ndarray, " n"]
    probability: Float[np.ndarray, "r n"]
    unobserved: Bool[np.ndarray, " n"]

    def without(self, unobserved: Bool[np.ndarray, " n"]) -> "SurfaceSegments":
        """Without segments that were found to be unobserved."""
        labels = renumbered(np.where(unobserved, -1, self.labels))
        return SurfaceSegments(labels, np.where(unobserved, 0.0, self.probability), self.unobserved | unobserved)


def surface_changes(
    clouds: tuple[SurfaceCloud, SurfaceCloud],
    surveys: tuple[Survey, Survey],
    scales: SurfaceScales,
    config: DetectionConfig,
) -> tuple[SurfaceSegments, SurfaceSegments]:
    """The segments of both clouds that changed.

    Args:
        clouds: both clouds with what is known of their points.
        surveys: the same clouds, with their views where they are known.
        scales: of the pair.
        config: the threshold, and whether there must be evidence.
    """
    before = surface_segments(clouds[0], surveys[1], scales, config)
    after = surface_segments(clouds[1], surveys[0], scales, config)
    if not config.evidence:
        return before, after
    under = supports(clouds[0].points, clouds[1].points, before.labels, after.labels, scales.spacing)
    # With the views of the other survey it is known what was covered.
    return (
        before.without(under[0]) if surveys[1].views is None else before,
        after.without(under[1]) if surveys[0].views is None else after,
    )


def surface_segments(
    cloud: SurfaceCloud,
    other: Survey,
    scales: SurfaceScales,
    config: DetectionConfig,
) -> SurfaceSegments:
    """The segments of one cloud that changed, and what the other survey did not see.

    Args:
        cloud: the cloud.
        other: the other cloud, with its views where they are known.
        scales: of the pair.
        config: the threshold, and whether there must be evidence.
    """
    probability = changed_probability(cloud, scales)
    mean = probability.mean(axis=0)
    labels = clusters_with_core(cloud.points, mean, scales.spacing, config.threshold)
    unobserved = np.zeros(len(labels), bool)
    if config.evidence:
        dropped, unobserved = put_to_evidence(cloud, labels, other, scales)
        labels = np.where(dropped, -1, labels)
    probability = np.where((labels < 0) & unobserved, 0.0, probability)
    return SurfaceSegments(renumbered(labels), probability, unobserved & (labels < 0))


def put_to_evidence(
    cloud: SurfaceCloud, labels: Int[np.ndarray, " n"], other: Survey, scales: SurfaceScales
) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """The points of the segments that do not lie where the other survey looked, and all points that it did not see.

    Args:
        cloud: the cloud.
        labels: -1, or the number of the segment.
        other: the other cloud, with its views where they are known.
        scales: of the pair.
    """
    if other.views is None:
        unobserved = continuing(cloud.points, labels, other.points, scales)
        return unobserved, unobserved
    observed = observation(cloud.points, other, scales.distance)
    dropped = not_seen_empty(cloud, labels, observed, other.points, scales)
    hidden = hidden_parts(cloud.points, np.where(dropped, -1, labels), observed, scales)
    shadows = continuing(cloud.points, hidden, other.points, scales)
    return dropped | shadows, (observed == Observed.unobserved) | dropped


def changed_probability(cloud: SurfaceCloud, scales: SurfaceScales) -> Float[np.ndarray, "r n"]:
    """For each restart the greatest of three: the mixture's posterior, and what distance and offset say.

    The mixture sees differences of density and extended changes; the distance sees small objects, for which it cannot
    spare a Gaussian; the offset sees thin ones, which are nearer to the other surface than its points to each other.
    """
    difference = cloud.difference
    by_distance = difference.distance / scales.sure_distance(difference)
    by_distance = np.clip((by_distance - FIRST_DISTANCE) / (1 - FIRST_DISTANCE), 0, 1)
    by_offset = np.clip(difference.offset / scales.sure_offset(difference), 0, 1)
    return np.maximum(cloud.excess, np.maximum(by_distance, by_offset)[None])


def clusters_with_core(
    points: Float[np.ndarray, "n 3"], probability: Float[np.ndarray, " n"], spacing: float, threshold: float
) -> Int[np.ndarray, " n"]:
    """Density clusters of nearly sure points, with the points beside them that reach the threshold.

    Were they clusters of all these points, a slight misregistration would chain half the scene to an object.
    """
    radius = CLUSTER_RADIUS * spacing
    labels = np.full(len(points), -1)
    core = np.flatnonzero(probability >= max(CORE_PROBABILITY, threshold))
    labels[core] = density_clusters(points[core], radius, CLUSTER_NEIGHBOURS)
    counts = np.bincount(labels[labels >= 0], minlength=1)
    labels[np.isin(labels, np.flatnonzero(counts < SMALLEST_CORE))] = -1
    core, others = np.flatnonzero(labels >= 0), np.flatnonzero((labels < 0) & (probability >= threshold))
    if len(core):
        tree = cKDTree(points[core])
        distances, nearest = tree.query(points[others], distance_upper_bound=GROWTH * radius, workers=-1)
        near = np.isfinite(distances)
        labels[others[near]] = labels[core[nearest[near]]]
    return labels


def not_seen_empty(
    cloud: SurfaceCloud,
    labels: Int[np.ndarray, " n"],
    observed: Int8[np.ndarray, " n"],
    other: Float[np.ndarray, "m 3"],
    scales: SurfaceScales,
) -> Bool[np.ndarray, " n"]:
    """The points of the segments whose place the other survey did not see to be empty.

    A place is empty where the survey looked through it. A thin object is too near to the surface behind it for that:
    there the survey saw a surface that is off this one, and the segment must not continue the surfaces beside it.
    """
    offset = cloud.difference.offset > THIN_OFFSET * scales.sure_offset(cloud.difference)
    free = observed == Observed.free
    thin = free | ((observed == Observed.surface) & offset)
    seen = observed != Observed.unobserved
    through = [
        label for label in np.unique(labels[labels >= 0]) if _mostly(free, seen, labels == label, LEAST_FREE_OF_ALL)
    ]
    rest = np.where(np.isin(labels, through), -1, labels)
    off = [label for label in np.unique(rest[rest >= 0]) if _mostly(thin, seen, labels == label, LEAST_THIN_OF_ALL)]
    candidates = np.where(np.isin(labels, off), labels, -1)
    thin_ones = (candidates >= 0) & ~continuing(cloud.points, candidates, other, scales)
    return (labels >= 0) & ~np.isin(labels, through) & ~thin_ones


def _mostly(empty: np.ndarray, seen: np.ndarray, own: np.ndarray, least_of_all: float) -> bool:
    """Whether enough of a segment is empty: of what was observed of it, and of all of it."""
    least = max(LEAST_FREE, LEAST_FREE_SHARE * seen[own].sum(), least_of_all * own.sum())
    return bool(empty[own].sum() >= least)


def hidden_parts(
    points: Float[np.ndarray, "n 3"],
    labels: Int[np.ndarray, " n"],
    observed: Int8[np.ndarray, " n"],
    scales: SurfaceScales,
) -> Int[np.ndarray, " n"]:
    """The parts of the segments that the other survey did not see, as segments of their own.

    The hidden side of an object belongs to it; a shadow on the wall behind it does not.
    """
    parts = np.full(len(labels), -1)
    hidden = np.flatnonzero((labels >= 0) & (observed == Observed.unobserved))
    parts[hidden] = density_clusters(points[hidden], CLUSTER_RADIUS * scales.spacing, CLUSTER_NEIGHBOURS)
    return parts


def continuing(
    points: Float[np.ndarray, "n 3"],
    labels: Int[np.ndarray, " n"],
    other: Float[np.ndarray, "m 3"],
    scales: SurfaceScales,
) -> Bool[np.ndarray, " n"]:
    """The points of the segments that only continue the unchanged surfaces beside them.

    An object and its shadow on the wall behind may be one segment: what continues and what does not are judged apart
    where either is a good part of it.
    """
    # What is further off than this is another surface: the top of a thin object does not cover the floor's plane.
    arguments = (labels < 0, other, SAME_SURFACE * scales.offset, scales.spacing)
    unseen = unobserved_points(points, labels, *arguments)
    whole = _shares(unseen, labels, int(labels.max(initial=-1)) + 1) > MOST_CONTINUED
    pieces, of_segment = _pieces(points, labels, unseen, scales.spacing)
    dropped = (labels >= 0) & whole[labels]
    if not len(of_segment):
        return dropped

    def continued(*, edges: bool) -> Bool[np.ndarray, " p"]:
        unseen = unobserved_points(points, pieces, *arguments, edges=edges)
        return np.asarray(_shares(unseen, pieces, len(of_segment))[:-1] > MOST_CONTINUED)

    of_piece = continued(edges=True)
    # The top of an object, by itself, can look like a wall at the edge of what the other survey saw.
    with_others = of_piece & np.isin(of_segment, of_segment[~of_piece])
    if with_others.any():
        of_piece &= ~with_others | continued(edges=False)
    return np.where(pieces >= 0, np.append(of_piece, False)[pieces], dropped)


def _pieces(
    points: np.ndarray, labels: np.ndarray, unseen: np.ndarray, spacing: float
) -> tuple[np.ndarray, np.ndarray]:
    """The good-sized clusters of the points of each segment that are unseen, and of those that are not."""
    pieces = np.full(len(labels), -1)
    of_segment: list[int] = []
    for label in np.unique(labels[labels >= 0]):
        own = labels == label
        least = max(SMALLEST_PIECE, SHARE_OF_PIECE * own.sum())
        for part in (np.flatnonzero(own & unseen), np.flatnonzero(own & ~unseen)):
            clusters = density_clusters(points[part], CLUSTER_RADIUS * spacing, CLUSTER_NEIGHBOURS)
            for number in np.flatnonzero(np.bincount(clusters[clusters >= 0]) >= least):
                pieces[part[clusters == number]] = len(of_segment)
                of_segment.append(int(label))
    return pieces, np.array(of_segment)


def _shares(flags: np.ndarray, labels: np.ndarray, count: int) -> np.ndarray:
    """The share of each label's points that are flagged; one more entry, 0, for the label -1."""
    inside = labels >= 0
    points = np.bincount(labels[inside], minlength=count)
    return np.append(np.bincount(labels[inside], flags[inside], count) / np.maximum(points, 1), 0.0)


def renumbered(labels: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The labels without gaps in their numbers."""
    result = labels.copy()
    result[labels >= 0] = np.unique(labels[labels >= 0], return_inverse=True)[1]
    return result
