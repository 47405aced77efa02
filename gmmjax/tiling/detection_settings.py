"""Settings of a detection in scans of any size."""

import dataclasses

from gmmjax.changes import LocalResolutionSettings
from gmmjax.clouds import StationSettings


@dataclasses.dataclass(frozen=True)
class TiledDetectionSettings:
    """Bounds on memory and time for scans of any size; what is found in them depends on the detector's settings.

    Attributes:
        thinned: voxels of either cloud that are kept in memory for the coarse pass. Fewer than the registration takes:
            it is less exact; more: memory.
        max_points: of both clouds in a block. Few: more is margin; many: more memory for each worker.
        resolution: how small the voxels are. Its `max_voxels` is a bound on time, about ten seconds of one core for a
            million: fewer, and dense scans are compared at less than their resolution.
        max_refined: fine voxels of either cloud around what looks changed; with more, the smallest ones are doubled. A
            bound on memory, a gigabyte for a million. Few: in scans with many changes small things are lost.
        stations: what is a station of a scanner, in scans without views.
    """

    thinned: int = 400_000
    max_points: int = 1_000_000
    resolution: LocalResolutionSettings = LocalResolutionSettings(max_voxels=4_000_000)
    max_refined: int = 2_000_000
    stations: StationSettings = StationSettings()
