"""Views from the stations of a scanner on a tripod, as a scan without views shows them itself."""

import numpy as np
from jaxtyping import Float64, Int

from gmmjax.changes.detectors.detector import Scan
from gmmjax.clouds import SensorViews, StationSettings, recognised_stations


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
