"""What a whole pair of scans says of a difference at one place: the limits, and the registration error there."""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes import (
    NAMES,
    DetectionLimits,
    DifferenceSettings,
    LocalDifference,
    detection_limits,
    median_errors,
    registration_errors,
    within_limits,
)
from gmmjax.geometry import evenly_chosen, nearest_neighbours
from gmmjax.pair import Pair, each, each_on_cores
from gmmjax.tiling.local_differences import BlockDifferences
from gmmjax.tiling.local_voxels import LocalVoxels


@dataclasses.dataclass(frozen=True)
class LocalScaleSettings:
    """What the scales of scans of any size are computed from.

    Attributes:
        voxels: of either cloud, evenly chosen, whose medians the limits are: a bound on memory. Few: uncertain limits.
    """

    voxels: int = 500_000


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
    """What a difference is compared with.

    Attributes:
        limits: of distances and offsets.
        errors: registration error of either cloud.
    """

    limits: DetectionLimits
    errors: Pair[RegistrationErrors]

    def errors_at(self, points: Pair[Float64[np.ndarray, "_ 3"]]) -> Pair[Float64[np.ndarray, " _"]]:
        """The registration error at points of either cloud."""
        return each(RegistrationErrors.at, self.errors, points)


def local_scales(
    voxels: LocalVoxels,
    differences: BlockDifferences,
    spacing: float,
    settings: DifferenceSettings,
    sampling: LocalScaleSettings = LocalScaleSettings(),
) -> LocalScales:
    """The scales of a pair by the differences of all its voxels.

    Args:
        voxels: of all blocks.
        differences: of all blocks.
        spacing: of neighbouring points, in the sparser cloud.
        settings: of the limits.
        sampling: how many voxels they are computed from.
    """
    sample = _sample(voxels, differences, sampling.voxels)
    limits = detection_limits(sample.map(lambda own: own.local), spacing, settings)

    def errors(side: str, own: _Sample) -> RegistrationErrors:
        rows = np.flatnonzero(within_limits(own.local, limits))
        if len(rows) < settings.region:
            return RegistrationErrors(np.zeros((1, 3)), np.array([limits.registration_error]))
        chosen = rows[evenly_chosen(len(rows), settings.regions)]
        found = [
            _of_block(side, int(number), own.indices[chosen][own.blocks[chosen] == number], voxels, differences, limits)
            for number in np.unique(own.blocks[chosen])
        ]
        places, medians = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return RegistrationErrors(places, registration_errors(places, medians, limits))

    return LocalScales(limits, each_on_cores(errors, NAMES, sample))


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


def _sample(voxels: LocalVoxels, differences: BlockDifferences, most: int) -> Pair[_Sample]:
    numbers = differences.records.numbers
    steps = voxels.counts.map(lambda count: max(1, -(-count // most)))
    parts = each_on_cores(lambda side, step: list(_chosen(differences, numbers, side, step)), NAMES, steps)
    return parts.map(lambda own: jax.tree.map(lambda *values: np.concatenate(values), *own))


def _chosen(differences: BlockDifferences, numbers: list[int], side: str, step: int) -> Iterator[_Sample]:
    passed = 0
    for number in numbers:
        local = differences.local(number, side)
        indices = np.arange(-passed % step, len(local.distance), step)
        passed += len(local.distance)
        yield _Sample(_rows(local, indices), np.full(len(indices), number), indices)


def _rows(local: LocalDifference, indices: Int[np.ndarray, " s"]) -> LocalDifference:
    chosen: LocalDifference = jax.tree.map(lambda values: values[indices], local)
    return chosen


def _of_block(
    side: str,
    number: int,
    indices: Int[np.ndarray, " p"],
    voxels: LocalVoxels,
    differences: BlockDifferences,
    limits: DetectionLimits,
) -> tuple[Float64[np.ndarray, "p 3"], Float[np.ndarray, " p"]]:
    """The registration error at some voxels of a block, by those around them in it."""
    local = differences.local(number, side)
    points: Float64[np.ndarray, "v 3"] = getattr(voxels.of_block(number), side).points
    return points[indices], median_errors(points, local, points[indices], limits)
