"""The voxels of all blocks with all that was measured of them: what the stages after the blocks read."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64

from gmmjax.changes import CandidateSettings, LocalDifference, PointFigures, probability_by_difference
from gmmjax.clouds import AbstractBlockStore
from gmmjax.tiling.local_differences import BlockDifferences
from gmmjax.tiling.local_scales import LocalScales
from gmmjax.tiling.local_voxels import LocalVoxels, Voxels


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

    store: AbstractBlockStore
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
        voxels: Voxels = getattr(self.voxels.of_block(number), side)
        error = getattr(self.scales.errors, side).at(voxels.points)
        local = self.differences.local(number, side)._replace(error=error)
        figures = self.differences.figures(number, side, error)
        return ComparedVoxels(
            voxels, local, figures, probability_by_difference(local, self.scales.limits, self.candidates)
        )
