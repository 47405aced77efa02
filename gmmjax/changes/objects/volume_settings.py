"""How the volumes of changes are measured."""

import dataclasses

from gmmjax.changes.objects.hull_volume import HullVolumeSettings
from gmmjax.changes.objects.surface_volume import SurfaceVolumeSettings


@dataclasses.dataclass(frozen=True)
class VolumeSettings:
    """Which volume a change has.

    All values are empirical: they come from development on the scenes of `tests/benchmarks/volumes`.

    Attributes:
        on_surface: fraction of a change's points, at least, that have a surface of the other scan below them, for the
            volume to be that between both surfaces. 0: it always is; above 1: it is always that of the hull.
        aligned: cosine, at least, between the normals of a point of a change and of the surface below it, of a layer on
            that surface; of a layer the signed distance tells whether it is a gain, of an object whether it came. 0:
            it always does, and a box before a wall may be taken for a part of the wall that receded.
        below: distance along the surface, in spacings of the other scan, up to which it has a surface below a point.
            0: no change has; infinite: the surface is taken to go on below a change that nobody saw the ground of.
        resting: fraction of a change's points, at least, that are near the surface of the other scan where it lies on
            that. With fewer it hangs, where its own scan shows that surface behind it, and the hull is measured. 0: a
            stray point near the surface makes it lie there; 1: a ring on a floor hangs.
        nearest: difference between the height of a point above the surface below it and that above the nearest point of
            the other scan, as a fraction of the former, at most. Where most points have a larger one, what is nearest
            is a wall, a rack or a shelf, and the change is measured down to the plane that it stands on. Infinite: it
            is always measured in the direction of what is nearest.
        same: fraction of the points of a change, at least, that lie in front of or behind those of a change of the
            other scan, of which it is the other surface: both have one volume. Above 1: it is counted twice.
        most_points: points of a scan about a change, at most: a bound on the memory.
        surfaces: how the volume between two surfaces is measured.
        hulls: how that of a closed object is.
    """

    on_surface: float = 0.5
    aligned: float = 0.7
    below: float = 3.0
    resting: float = 0.05
    nearest: float = 0.5
    same: float = 0.5
    most_points: int = 2_000_000
    surfaces: SurfaceVolumeSettings = SurfaceVolumeSettings()
    hulls: HullVolumeSettings = HullVolumeSettings()
