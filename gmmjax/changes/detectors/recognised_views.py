"""Where the sensor stood of which nobody has given any views, as the scan itself shows it.

The stations of a scanner on a tripod become views. That a scan is a frame of a depth camera at its origin tells only
from which side its surfaces are seen: which places are empty is not asked of a camera that nobody has vouched for.
"""

import numpy as np
from jaxtyping import Float64, Int

from gmmjax.changes.detectors.detector import Scan
from gmmjax.clouds import DepthFrameSettings, SensorViews, StationSettings, is_depth_frame, recognised_stations


def with_recognised_views(
    scan: Scan,
    points: Float64[np.ndarray, "n 3"],
    settings: StationSettings = StationSettings(),
    counts: Int[np.ndarray, " n"] | None = None,
) -> Scan:
    """The scan with views of its stations, where it has no views and shows its stations.

    Args:
        scan: with or without views.
        points: of the scan that are used, or the means of its voxels.
        settings: what is a station.
        counts: how many points each of them stands for; None: one.
    """
    if scan.views is not None:
        return scan
    stations = recognised_stations(points, counts, settings)
    if not len(stations):
        return scan
    return scan._replace(views=SensorViews.from_positions(points, stations), recognised=True)


def as_depth_frame(
    scan: Scan, points: Float64[np.ndarray, "n 3"], settings: DepthFrameSettings = DepthFrameSettings()
) -> Scan:
    """The scan, marked where it has no views and is a frame of a depth camera at its origin.

    Args:
        scan: with or without views.
        points: of the scan as they were measured, or a part of them.
        settings: what is a frame.
    """
    if scan.views is not None or scan.depth_frame:
        return scan
    return scan._replace(depth_frame=is_depth_frame(points, settings))
