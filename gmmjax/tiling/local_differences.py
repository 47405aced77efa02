"""Distances of the voxels of one scan from the surface of the other, block by block.

A block sees its own voxels, those of its neighbours in a margin of some voxels, and beyond them the coarse cloud that
the scans were registered in: what is compared with far away need not be fine.
"""

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int64
from scipy.spatial import cKDTree

from gmmjax.changes import (
    NAMES,
    CorePoints,
    DifferenceSettings,
    LocalDifference,
    M3C2Settings,
    PointFigures,
    SignedDistanceSettings,
    distances_at,
    local_difference,
)
from gmmjax.geometry import LocalSurface, nearest_neighbours, within_box
from gmmjax.pair import Pair, each
from gmmjax.tiling.block_store import BlockStore
from gmmjax.tiling.blocks import Block
from gmmjax.tiling.local_voxels import Box, LocalVoxels
from gmmjax.tiling.records import Arrays, BlockRecords

# Width of the zone around a block, in its voxels, whose own voxels are seen. Small: planes at the rim of a block are of
# fewer points, and what has moved out of it has coarse counterparts; large: more work twice.
MARGIN = 12.0
# Voxels of other blocks that are so many times as small as the block's are joined: next to a sparse block may be dense
# ones, and large voxels have a wide margin. Infinite: time and memory grow with the range of densities.
MARGIN_FINENESS = 4.0
# Points of either cloud in the margin that the signed distance is measured in, evenly chosen, 60 bytes each.
MARGIN_POINTS = 1_000_000
# Width of the zone of coarse points around it, in their voxels. Small: a block may be far from what surrounds it.
COARSE_MARGIN = 8.0
# Coarse points that are seen, however far they are, where none is in that zone.
NEAREST = 64


class CoarseClouds(NamedTuple):
    """The clouds that the scans were registered in, and where they were seen from, relative to the offset.

    Attributes:
        points: of both.
        voxel_size: of their voxels.
        towards: where the sensor of each survey stood, or is taken to have stood.
    """

    points: Pair[Float64[np.ndarray, "_ 3"]]
    voxel_size: float
    towards: Pair[Float64[np.ndarray, "_ 3"]]


def block_differences(
    store: BlockStore,
    block: Block,
    voxels: LocalVoxels,
    coarse: CoarseClouds,
    settings: DifferenceSettings,
    distances: SignedDistanceSettings,
) -> Arrays:
    """The differences of the voxels of a block, a `BlockTask` whose arrays `BlockDifferences` reads.

    Args:
        store: of the block.
        block: one of the store's.
        voxels: of all blocks.
        coarse: what is compared with beyond the margin.
        settings: how distance and offset are measured.
        distances: of the cylinders of the signed distance.
    """
    own = NAMES.map(lambda side: voxels.of_cloud(block.number, side))
    size = float(np.median(np.concatenate([side.sizes for side in own])))
    margin = MARGIN * size
    fine = _fine_around(store.tree.near(block, margin), voxels, block.grown(margin), size / MARGIN_FINENESS)
    rough = coarse.points.map(lambda side: _coarse_around(block, side, margin, coarse.voxel_size))
    points = own.map(lambda side: side.points)
    surfaces = each(lambda *parts: LocalSurface.of(np.concatenate(parts)), points, fine, rough)
    inside = points.map(lambda side: np.arange(len(side)))
    compared = functools.partial(local_difference, settings=settings)
    local = each(compared, surfaces, surfaces.swapped, inside)
    spacings = each(lambda surface, chosen: surface.spacing(chosen), surfaces, inside)
    cores = each(CorePoints.of, surfaces, coarse.towards, inside)
    scans = store.points_around(block, margin, MARGIN_POINTS)
    none = points.map(lambda side: np.zeros(len(side)))
    figures = distances_at(scans, cores, local, none, distances, margin)
    values: dict[str, np.ndarray] = {}
    for side, *found in zip(NAMES, local, spacings, figures, strict=True):
        values |= {f"{name}_{side}": array for name, array in _named(*found).items()}
    return values


_DIFFERENCES = ("distance", "offset", "noise", "thickness", "spacing", "point_offset", "point_noise")


def _named(
    local: LocalDifference, own_spacing: Float[np.ndarray, " v"], figures: PointFigures
) -> dict[str, Float[np.ndarray, " v"]]:
    values = {name: getattr(local, name) for name in _DIFFERENCES}
    values |= {"own_spacing": own_spacing, "signed": figures.distance, "detection": figures.level_of_detection}
    return {name: array.astype(np.float32) for name, array in values.items()}


@dataclasses.dataclass(frozen=True, eq=False)
class BlockDifferences:
    """The differences of the voxels of all blocks.

    Attributes:
        records: of `block_differences`.
    """

    records: BlockRecords

    def local(self, number: int, side: str) -> LocalDifference:
        """The differences of the voxels of one cloud in a block, the registration error of the pair everywhere.

        Args:
            number: of the block.
            side: "before" or "after".
        """
        names = {f"{name}_{side}": name for name in (*_DIFFERENCES, "own_spacing")}
        values = self.records.values(number, *names)
        return LocalDifference(**{name: values[stored].astype(np.float64) for stored, name in names.items()})

    def figures(self, number: int, side: str, error: Float[np.ndarray, " v"]) -> PointFigures:
        """The signed distance at the voxels of one cloud in a block.

        Args:
            number: of the block.
            side: "before" or "after".
            error: the registration error at each voxel.
        """
        values = self.records.values(number, f"signed_{side}", f"detection_{side}")
        standard_errors = np.float32(M3C2Settings.standard_errors)
        distance, without = (own.astype(np.float32) for own in values.values())
        # Equation (1) of M3C2 adds the error to the standard error of the means.
        detection = without + standard_errors * error.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            significance = np.where(distance == 0, 0 * detection, np.abs(distance) / (detection / standard_errors))
        return PointFigures(distance, detection, significance)


def _fine_around(
    numbers: Int64[np.ndarray, " b"], voxels: LocalVoxels, box: Box, least: float
) -> Pair[Float64[np.ndarray, "_ 3"]]:
    """The voxels of some blocks in a box, those below a size joined; one block after the other, to save memory."""
    return NAMES.map(
        lambda side: np.concatenate(
            [np.empty((0, 3)), *(voxels.of_cloud(number, side, least, box).points for number in numbers.tolist())]
        )
    )


def _coarse_around(
    block: Block, everywhere: Float64[np.ndarray, "c 3"], margin: float, voxel_size: float
) -> Float64[np.ndarray, "n 3"]:
    """The coarse points around a block, beyond the margin in which fine ones are seen."""
    boxes = block.grown(margin), block.grown(margin + COARSE_MARGIN * voxel_size)
    inner, outer = (within_box(everywhere, *box) for box in boxes)
    around = np.setdiff1d(outer, inner, assume_unique=True)
    if not len(around):
        around = nearest_neighbours(cKDTree(everywhere), block.centre[None], NEAREST)[1][0]
    return everywhere[around]
