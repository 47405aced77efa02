"""The stage that gathers points which look changed in segments: the candidates for changes."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8
from scipy.spatial import cKDTree

from gmmjax.changes.differences import DetectionLimits, Differences, LocalDifference
from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.geometry import density_clusters, workers_for
from gmmjax.pair import Pair, parallel_map


@dataclasses.dataclass(frozen=True)
class CandidateSettings:
    """Which points look changed, and how they are gathered.

    Attributes:
        first_distance: fraction of the limit of the distance up to which its probability is 0.
        core_probability: of the nearly sure points that clusters are made of, and from which on the offset of a point
            itself counts. At the threshold: a slight misregistration chains half a scene to one cluster, and single
            points of a floor are taken along with what stands on it.
        smallest_core: number of such points that a candidate has, at least.
        smallest_local_core: the same where voxels are as small as the scans allow at each place. Fewer: noise makes
            candidates; 20: what the scans show with a dozen points is lost.
        cluster_radius: within which such points are neighbours, in spacings (the radius of DBSCAN).
        sparse_radius: the same in spacings of the cloud at a place, where that is larger: far from a scanner an object
            has few points. 0: of these nothing is found, or pieces; as `cluster_radius`: what lies side by side there
            is one candidate.
        widest_radius: the same, in `cluster_radius`, at most. 1: as if `sparse_radius` were 0; infinite: stray points
            that are far from everything make candidates.
        cluster_neighbours: of a core point, itself counted (the minimum of DBSCAN).
        growth: a candidate takes in points that reach the threshold within this many radii.
        outliers: largest fraction of these nearly sure points that may belong to no surface, empirical: single points
            in the air between two surfaces are no change. 1: where a dense scan has many of them they are candidates.
    """

    first_distance: float = 0.3
    core_probability: float = 0.9
    smallest_core: int = 20
    smallest_local_core: int = 10
    cluster_radius: float = 5.0
    sparse_radius: float = 2.5
    widest_radius: float = 4.0
    cluster_neighbours: int = 8
    growth: float = 2.0
    outliers: float = 0.9

    @property
    def local(self) -> "CandidateSettings":
        """The same where voxels are as small as the scans allow at each place."""
        return dataclasses.replace(self, smallest_core=self.smallest_local_core)


class Candidates(NamedTuple):
    """The candidates of one cloud.

    Attributes:
        points: of the cloud, at the working resolution.
        difference: of each to the other cloud.
        excess: for each restart the posterior of the joint mixture that the point is of what only its cloud has.
        looks_changed: probability that the point looks changed, mean over the restarts.
        labels: -1, or the number of the candidate.
        observed: what the other survey observed at the place of each point, values of `Observed`; None: its views are
            not known.
    """

    points: Float[np.ndarray, "n 3"]
    difference: LocalDifference
    excess: RestartValues
    looks_changed: Float[np.ndarray, " n"]
    labels: Int[np.ndarray, " n"]
    observed: Int8[np.ndarray, " n"] | None = None

    @property
    def free(self) -> Bool[np.ndarray, " n"] | None:
        """Which points are in free space of the other survey; None: its views are not known."""
        return None if self.observed is None else self.observed > 0


def candidates_of(
    points: Pair[Float[np.ndarray, "_ 3"]],
    differences: Differences,
    excess: Pair[RestartValues],
    observed: Pair[Int8[np.ndarray, " _"] | None] = Pair(None, None),
    threshold: float = 0.5,
    settings: CandidateSettings = CandidateSettings(),
    sizes: Pair[Float[np.ndarray, " _"] | None] = Pair(None, None),
    outliers: Pair[Bool[np.ndarray, " _"] | None] = Pair(None, None),
    spacings: Pair[Float[np.ndarray, " _"] | None] = Pair(None, None),
) -> Pair[Candidates]:
    """The candidates of both clouds.

    Args:
        points: at the working resolution.
        differences: of the clouds from each other.
        excess: for each restart the posterior of the joint mixture that the point is of what only its cloud has.
        observed: what the other survey observed at the place of each point; None: its views are not known.
        threshold: probability from which on a point belongs to a candidate.
        settings: which points look changed.
        sizes: of the voxel of each point, where they differ from place to place; None: the scans are compared in voxels
            of one size, or point by point.
        outliers: which points belong to no surface; None: none of them.
        spacings: of the points of each cloud at each of them; None: that of the pair is everywhere. Where the voxels
            differ, their sizes count.
    """
    limits = differences.limits

    def of_cloud(
        points: np.ndarray,
        difference: LocalDifference,
        excess: RestartValues,
        observed: np.ndarray | None,
        sizes: np.ndarray | None,
        outliers: np.ndarray | None,
        spacings: np.ndarray | None,
    ) -> Candidates:
        by_difference = probability_by_difference(difference, limits, settings)
        spacing: float | np.ndarray
        if sizes is None:
            spacing = _cluster_spacing(spacings, limits.spacing, settings)
            own, looks_changed = settings, mean_probability(excess, by_difference)
        else:
            # The mixture's Gaussians are far larger than what the finest voxels show.
            spacing, own, looks_changed = sizes, settings.local, by_difference
            if observed is not None:
                # What the other survey looked through was not there, however near its next surface is.
                looks_changed = np.where(observed > 0, 1.0, by_difference)
        labels = clusters_by_observation(points, looks_changed, observed, spacing, threshold, own, outliers)
        return Candidates(points, difference, excess, looks_changed, labels, observed)

    return parallel_map(of_cloud, points, differences.local, excess, observed, sizes, outliers, spacings)


def _cluster_spacing(
    spacings: Float[np.ndarray, " n"] | None, of_pair: float, settings: CandidateSettings
) -> float | Float[np.ndarray, " n"]:
    """The spacing of the pair, and where a cloud is far sparser a power of two times as much."""
    if spacings is None:
        return of_pair
    wider = settings.sparse_radius * spacings / (settings.cluster_radius * of_pair)
    return np.asarray(of_pair * 2.0 ** np.round(np.log2(np.clip(wider, 1.0, settings.widest_radius))))


def probability_by_difference(
    difference: LocalDifference, limits: DetectionLimits, settings: CandidateSettings = CandidateSettings()
) -> Float[np.ndarray, " n"]:
    """What distance and offset say, whichever is greater, of each point.

    The distance sees small objects, for which the mixture cannot spare a Gaussian; the offset sees thin ones, which are
    nearer to the other surface than its points to each other.

    Args:
        difference: of each point to the other cloud.
        limits: of distances and offsets.
        settings: where the probability by distance begins.
    """
    by_distance = difference.distance / limits.local_distance(difference)
    by_distance = np.clip((by_distance - settings.first_distance) / (1 - settings.first_distance), 0, 1)
    of_mean, of_point = limits.relative_mean_offset(difference), limits.relative_point_offset(difference)
    # Half the limit is common among single points: those beside a change would be taken along.
    of_point = np.where(of_point >= settings.core_probability, of_point, 0.0)
    return np.asarray(np.clip(np.maximum.reduce([by_distance, of_mean, of_point]), 0, 1))


def mean_probability(excess: RestartValues, by_difference: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The probability that each point looks changed, the mean over the restarts.

    For each restart the greater of two: the mixture's posterior, which sees differences of density and extended
    changes, and what distance and offset say.

    Args:
        excess: the mixture's posterior.
        by_difference: what distance and offset say.
    """
    total = np.zeros_like(by_difference)
    for of_restart in excess.each():
        total += np.maximum(of_restart, by_difference)
    return total / excess.restarts


def clusters_by_observation(
    points: Float[np.ndarray, "n 3"],
    probability: Float[np.ndarray, " n"],
    observed: Int8[np.ndarray, " n"] | None,
    spacing: float | Float[np.ndarray, " n"],
    threshold: float = 0.5,
    settings: CandidateSettings = CandidateSettings(),
    outliers: Bool[np.ndarray, " n"] | None = None,
) -> Int[np.ndarray, " n"]:
    """The clusters of `clusters_with_core`, of the places that the other survey observed and of the others.

    What was observed is never in one cluster with what was not: an object beside the edge of the coverage would be lost
    in all that lies beyond it.

    Args:
        points: of one cloud.
        probability: that each is changed.
        observed: what the other survey observed at each place, negative for nothing; None: not known.
        spacing: of neighbouring points, at each point or everywhere.
        threshold: probability from which on a point belongs to a cluster.
        settings: of the clusters.
        outliers: which points belong to no surface; None: none of them.

    Returns:
        For each point -1, or the number of its cluster.
    """
    labels, spacings = np.full(len(points), -1), np.broadcast_to(spacing, len(points))
    groups: list[Bool[np.ndarray, " n"]] = [np.ones(len(points), bool)]
    if observed is not None:
        groups = [observed >= 0, observed < 0]
    for group in groups:
        of_group = None if outliers is None else outliers[group]
        own = clusters_with_core(points[group], probability[group], spacings[group], threshold, settings, of_group)
        labels[group] = np.where(own >= 0, own + labels.max(initial=-1) + 1, -1)
    return labels


def clusters_with_core(
    points: Float[np.ndarray, "n 3"],
    probability: Float[np.ndarray, " n"],
    spacing: float | Float[np.ndarray, " n"],
    threshold: float = 0.5,
    settings: CandidateSettings = CandidateSettings(),
    outliers: Bool[np.ndarray, " n"] | None = None,
) -> Int[np.ndarray, " n"]:
    """Density clusters of nearly sure points, with the points beside them that reach the threshold.

    Clusters nearly all of whose sure points belong to no surface are left out. Rays that hit an edge and what is behind
    it end in the air in between, at other places in every scan: the denser a scan, the nearer they are to each other.

    Args:
        points: of one cloud.
        probability: that each is changed.
        spacing: of neighbouring points, at each point or everywhere.
        threshold: probability from which on a point belongs to a cluster.
        settings: of the clusters.
        outliers: which points belong to no surface; None: none of them.

    Returns:
        For each point -1, or the number of its cluster.
    """
    radius = settings.cluster_radius * np.broadcast_to(spacing, len(points))
    labels = np.full(len(points), -1)
    core = np.flatnonzero(probability >= max(settings.core_probability, threshold))
    labels[core] = density_clusters(points[core], radius[core], settings.cluster_neighbours)
    counts = np.bincount(labels[labels >= 0], minlength=1)
    outlying = 0 if outliers is None else np.bincount(labels[(labels >= 0) & outliers], minlength=len(counts))
    rejected = (counts < settings.smallest_core) | (outlying > settings.outliers * counts)
    labels[np.isin(labels, np.flatnonzero(rejected))] = -1
    core, others = np.flatnonzero(labels >= 0), np.flatnonzero((labels < 0) & (probability >= threshold))
    if len(core):
        tree, reach, workers = cKDTree(points[core]), settings.growth * radius[others], workers_for(len(others))
        distances, nearest = tree.query(points[others], distance_upper_bound=reach.max(initial=0.0), workers=workers)
        near = distances < reach
        labels[others[near]] = labels[core[nearest[near]]]
    return labels
