"""The voxels of all blocks with all that was measured of them: what the stages after the blocks read.

The limits and the registration error, which differences are compared with, are those of the whole pair of scans.
"""

import dataclasses
import functools
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes import (
    NAMES,
    CandidateSettings,
    DetectionLimits,
    DifferenceSettings,
    LocalDifference,
    PointFigures,
    detection_limits,
    median_errors,
    probability_by_difference,
    registration_errors,
    within_limits,
)
from gmmjax.geometry import evenly_chosen, nearest_neighbours
from gmmjax.pair import Pair, parallel_map
from gmmjax.tiling.block_store import BlockStore
from gmmjax.tiling.local_differences import BlockDifferences
from gmmjax.tiling.local_voxels import LocalVoxels, Voxels

# Of either cloud, evenly chosen, whose medians the limits are: a bound on memory. Few: uncertain limits.
SAMPLED_VOXELS = 500_000


class RegistrationErrors(NamedTuple):
    """The registration error of a cloud at some places; elsewhere it is that of the nearest one.

    Attributes:
        places: relative to the offset.
        errors: there.
    """

    places: Float64[np.ndarray, "p 3"]
    errors: Float64[np.ndarray, " p"]

    def at(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, " n"]:
        """The error at given points."""
        return np.asarray(self.errors[nearest_neighbours(cKDTree(self.places), points, 1)[1][:, 0]])


class LocalScales(NamedTuple):
    """The scales that differences are compared with.

    Attributes:
        limits: of distances and offsets.
        errors: registration error of either cloud.
    """

    limits: DetectionLimits
    errors: Pair[RegistrationErrors]


def local_scales(
    voxels: LocalVoxels, differences: BlockDifferences, spacing: float, settings: DifferenceSettings
) -> LocalScales:
    """The scales of a pair by the differences of all its voxels.

    Args:
        voxels: of all blocks.
        differences: of all blocks.
        spacing: of neighbouring points, in the sparser cloud.
        settings: of the limits.
    """
    sample = _sample(voxels, differences)
    limits = detection_limits(sample.map(lambda own: own.local), spacing, settings)
    errors = functools.partial(_errors, voxels, differences, limits, settings)
    return LocalScales(limits, parallel_map(errors, NAMES, sample))


def _errors(
    voxels: LocalVoxels,
    differences: BlockDifferences,
    limits: DetectionLimits,
    settings: DifferenceSettings,
    side: str,
    own: "_Sample",
) -> RegistrationErrors:
    """The registration error of one cloud."""
    rows = np.flatnonzero(within_limits(own.local, limits))
    if len(rows) < settings.region:
        return RegistrationErrors(np.zeros((1, 3)), np.array([limits.registration_error]))
    chosen = rows[evenly_chosen(len(rows), settings.regions)]
    places, medians = [], []
    for number in np.unique(own.blocks[chosen]).tolist():
        points = voxels.of_cloud(number, side).points
        places.append(points[own.indices[chosen][own.blocks[chosen] == number]])
        medians.append(median_errors(points, differences.local(number, side), places[-1], limits))
    together = np.concatenate(places)
    return RegistrationErrors(together, registration_errors(together, np.concatenate(medians), limits))


class _Sample(NamedTuple):
    """Some voxels of a cloud, evenly chosen in the order of the blocks.

    Attributes:
        local: their differences.
        blocks: the number of the block of each.
        indices: of each in its block.
    """

    local: LocalDifference
    blocks: Int[np.ndarray, " s"]
    indices: Int[np.ndarray, " s"]


def _sample(voxels: LocalVoxels, differences: BlockDifferences) -> Pair[_Sample]:
    steps = voxels.counts.map(lambda count: max(1, -(-count // SAMPLED_VOXELS)))
    parts = parallel_map(lambda side, step: list(_chosen(differences, side, step)), NAMES, steps)
    return parts.map(lambda own: jax.tree.map(lambda *values: np.concatenate(values), *own))


def _chosen(differences: BlockDifferences, side: str, step: int) -> Iterator[_Sample]:
    passed = 0
    for number in differences.records.numbers:
        local = differences.local(number, side)
        indices = np.arange(-passed % step, len(local.distance), step)
        passed += len(local.distance)
        chosen: LocalDifference = jax.tree.map(lambda values, rows=indices: values[rows], local)
        yield _Sample(chosen, np.full(len(indices), number), indices)


class ComparedVoxels(NamedTuple):
    """The voxels of one cloud in a block.

    Attributes:
        voxels: of the cloud.
        local: their differences from the other cloud, with the registration error at each.
        figures: the signed distance at each.
        looks_changed: probability that each looks changed, by distance and offset.
    """

    voxels: Voxels
    local: LocalDifference
    figures: PointFigures
    looks_changed: Float64[np.ndarray, " v"]


@dataclasses.dataclass(frozen=True, eq=False)
class ComparedBlocks:
    """All blocks of two clouds, compared.

    Attributes:
        store: of the blocks.
        voxels: of all blocks.
        differences: of all blocks.
        scales: what these are compared with.
        candidates: where the probability by distance begins.
    """

    store: BlockStore
    voxels: LocalVoxels
    differences: BlockDifferences
    scales: LocalScales
    candidates: CandidateSettings

    def side(self, number: int, side: str) -> ComparedVoxels:
        """The voxels of one cloud in a block.

        Args:
            number: of the block.
            side: "before" or "after".
        """
        voxels = self.voxels.of_cloud(number, side)
        error: Float64[np.ndarray, " v"] = getattr(self.scales.errors, side).at(voxels.points)
        local = self.differences.local(number, side)._replace(error=error)
        figures = self.differences.figures(number, side, error)
        return ComparedVoxels(
            voxels, local, figures, probability_by_difference(local, self.scales.limits, self.candidates)
        )
