"""How scans of any size are compared."""

import dataclasses

import numpy as np

from gmmjax.changes import LocalResolutionSettings
from gmmjax.clouds import BlockSettings, StationSettings
from gmmjax.tiling.local_differences import LocalDifferenceSettings
from gmmjax.tiling.local_scales import LocalScaleSettings
from gmmjax.tiling.regions_of_interest import RegionsOfInterestSettings
from gmmjax.tiling.tiles import TileSettings


@dataclasses.dataclass(frozen=True)
class TiledDetectionSettings:
    """How scans of any size are compared; what is found in them depends on the detector's settings.

    Attributes:
        thinned: voxels of either cloud that are kept in memory for the coarse pass. Fewer than the registration takes:
            it is less exact; more: memory.
        largest_voxel: edge of the largest voxels where scans are so sparse that the coarse pass takes all their points,
            in spacings. Small: what is sparser than most of a scan is compared in voxels of single points.
        most_points: of both clouds in a block. Few: more is margin; many: more memory for each worker.
        resolution: how small the voxels are. Its `most_voxels` is a bound on time, about ten seconds of one core for a
            million: fewer, and dense scans are compared at less than their resolution.
        differences: what the voxels of a block are compared with.
        scales: what the limits are computed from.
        regions: how much is taken at full resolution around what looks changed.
        tiles: how blocks are put together.
        stations: what is a station of a scanner, in scans without views.
    """

    thinned: int = 400_000
    largest_voxel: float = 2.0
    most_points: int = 1_000_000
    resolution: LocalResolutionSettings = LocalResolutionSettings(most_voxels=4_000_000)
    differences: LocalDifferenceSettings = LocalDifferenceSettings()
    scales: LocalScaleSettings = LocalScaleSettings()
    regions: RegionsOfInterestSettings = RegionsOfInterestSettings()
    tiles: TileSettings = TileSettings()
    stations: StationSettings = StationSettings()

    @property
    def blocks(self) -> BlockSettings:
        """Of blocks by their number of points alone: their voxels are chosen later."""
        return BlockSettings(finest_voxel=np.inf, most_points=float(self.most_points))
