"""The signed distance between two scans at each point: by how much, and to which side, the surface has moved there.

The distance is that between local means along the normal of the other cloud's surface, as of M3C2 (Lague, Brodu and
Leroux 2013, section 3); a normal points to the side that the surface was scanned from.
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial import cKDTree

from gmmjax.changes.differences import Differences, LocalDifference
from gmmjax.clouds import SensorViews
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class SignedDistanceSettings:
    """Where a point has a surface to be compared with.

    Attributes:
        reach: distance along the other cloud's surface, in its point spacings, from a point's projection to the nearest
            point there, at most: the part of M3C2's cylinder. Infinite: beyond an edge the distance is that to the
            continued plane.
    """

    reach: float = 3.0


def signed_distances(
    surfaces: Pair[LocalSurface],
    differences: Differences,
    views: Pair[SensorViews | None],
    settings: SignedDistanceSettings = SignedDistanceSettings(),
) -> Pair[Float[np.ndarray, " _"]]:
    """The distance from the before to the after surface at each point of either cloud, in the unit of the clouds.

    Positive where the after surface lies on the outer side of the before one: towards the sensor, or, where no views
    are known, towards a point high above the middle of the cloud, along z.

    Args:
        surfaces: of both clouds, registered.
        differences: of them from each other.
        views: where the sensor stood, in the before frame; None: not known.
        settings: where there is something to compare with.

    Returns:
        A distance for each point, NaN where the other cloud has no surface to compare with.
    """
    senses = each(_senses, surfaces, views)

    def of_cloud(own: LocalDifference, senses: Float64[np.ndarray, " m"]) -> np.ndarray:
        assert own.counterpart is not None and own.signed_offset is not None
        along_surface = np.sqrt(np.maximum(own.distance**2 - own.offset**2, 0))
        compared = along_surface <= settings.reach * own.spacing
        return np.where(compared, senses[own.counterpart] * own.signed_offset, np.nan)

    found = each(of_cloud, differences.local, senses.swapped)
    # Of a point of the before cloud it is the after surface that lies on the other side.
    return Pair(-found.before, found.after)


def _senses(surface: LocalSurface, views: SensorViews | None) -> Float64[np.ndarray, " n"]:
    """1 where a normal points to where the surface was scanned from, -1 where it points away from it."""
    if views is None:
        lower, upper = surface.tree.mins, surface.tree.maxes
        towards = (lower + upper) / 2 + np.array([0.0, 0.0, (upper - lower).max()])
    else:
        positions = views.poses[:, :3, 3]
        towards = positions[cKDTree(positions).query(surface.points)[1]]
    return np.where(((towards - surface.points) * surface.normals).sum(axis=1) < 0, -1.0, 1.0)
