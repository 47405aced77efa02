"""Without sensor poses: which changes are only the support plane of a change in the other cloud.

An object occludes the shelf that it stands on, and what lies in its shadow. When the object goes, the shelf appears;
when it comes, the shelf disappears. But what stands on a surface shows that the surface is there.
"""

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float64, Int

from gmmjax.clouds import voxel_grid
from gmmjax.geometry import Plane, PlaneSettings, plane_surface, planes_of
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class SupportSettings:
    """When a segment is the support plane of a segment of the other cloud. Lengths in spacings, where they say so.

    Attributes:
        planes: how the plane of a support is found; one plane must hold `planes.least_share` of its voxels. Lower:
            boxes are taken for supports of what stands against them.
        voxel: edge of those voxels, in spacings, so that the number of a plane's inliers measures an area. Smaller:
            dense parts of a segment outweigh large ones.
        noise_deviations: largest distance of an inlier from the plane, in standard deviations of the segment's noise.
            Smaller: noisy supports are not flat.
        least_flatness: the same, in spacings, at least, where the surface is without noise. 0: only rounding is allowed
            for.
        most_below: fraction of an object's points below its support plane, at most: outliers. 1: what reaches through
            the plane stands on it.
        touching: height above the plane, in spacings, within which points of an object touch it. Smaller: objects whose
            lowest points pass for unchanged do not touch it; larger: objects that hang above it do.
        least_touching: number of such points that have a point of the support next to them along the plane, at least.
            0: every object above the infinite plane stands on it.
        adjacent: distance along the plane, in spacings, at which these have it. Larger: objects next to a support stand
            on it.
    """

    planes: PlaneSettings = PlaneSettings(least_share=0.75)
    voxel: float = 2.0
    noise_deviations: float = 3.0
    least_flatness: float = 0.5
    most_below: float = 0.03
    touching: float = 3.0
    least_touching: int = 8
    adjacent: float = 5.0


def supports(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    labels: Pair[Int[np.ndarray, " _"]],
    spacing: float,
    settings: SupportSettings = SupportSettings(),
) -> Pair[Bool[np.ndarray, " _"]]:
    """The points of the segments of either cloud that a segment of the other cloud stands on.

    Of two flat segments that could stand on each other neither is taken for a support.

    Args:
        points: of both clouds.
        labels: -1, or the number of the segment that a point belongs to.
        spacing: distance of neighbouring points on a surface.
        settings: when a segment is a support.
    """
    segments = each(lambda own, label: _segments(own, label, spacing, settings), points, labels)
    gone, new = segments.before, segments.after
    under = {(i, j) for i, own in gone.items() for j, change in new.items() if own.supports(change)}
    over = {(i, j) for i, change in gone.items() for j, own in new.items() if own.supports(change)}
    return Pair(
        np.isin(labels.before, [i for i, _ in under - over]),
        np.isin(labels.after, [j for _, j in over - under]),
    )


@dataclasses.dataclass(frozen=True, eq=False)
class _Segment:
    """One segment; its plane is found once, when it is asked for.

    Attributes:
        points: of the segment.
        spacing: distance of neighbouring points on a surface.
        settings: when a segment is a support.
    """

    points: Float64[np.ndarray, "n 3"]
    spacing: float
    settings: SupportSettings

    @functools.cached_property
    def plane(self) -> tuple[Plane | None, float]:
        """The plane that most of it lies on, if there is one, and the largest deviation from it by noise."""
        return _support_plane(self.points, self.spacing, self.settings)

    @functools.cached_property
    def bounds(self) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
        """Its least and its greatest coordinates."""
        return self.points.min(axis=0), self.points.max(axis=0)

    def supports(self, change: "_Segment") -> bool:
        """Whether it is flat, and a change of the other cloud stands on it."""
        reach = (self.settings.adjacent + self.settings.touching) * self.spacing
        (lower, upper), (least, greatest) = self.bounds, change.bounds
        if (least > upper + reach).any() or (greatest < lower - reach).any():
            return False
        plane, noise = self.plane
        return plane is not None and _stands_on(change.points, self.points, plane, noise, self.spacing, self.settings)


def _segments(points: np.ndarray, labels: np.ndarray, spacing: float, settings: SupportSettings) -> dict[int, _Segment]:
    return {
        int(label): _Segment(points[labels == label], spacing, settings) for label in np.unique(labels[labels >= 0])
    }


def _support_plane(
    segment: Float64[np.ndarray, "n 3"], spacing: float, settings: SupportSettings
) -> tuple[Plane | None, float]:
    """The plane that most of a segment lies on, if there is one, and the largest deviation from it by noise."""
    noise = settings.noise_deviations * plane_surface(segment, settings.planes).thickness
    thinned = voxel_grid(segment, settings.voxel * spacing).points
    flatness = max(noise, settings.least_flatness * spacing)
    planes = planes_of(plane_surface(thinned, settings.planes), flatness, settings=settings.planes)
    return (planes[0] if planes else None), noise


def _stands_on(
    change: Float64[np.ndarray, "m 3"],
    segment: Float64[np.ndarray, "n 3"],
    plane: Plane,
    noise: float,
    spacing: float,
    settings: SupportSettings,
) -> bool:
    heights = change @ plane.normal - plane.offset
    heights *= 1 if np.median(heights) >= 0 else -1
    if (heights < -(noise + spacing)).mean() > settings.most_below:
        return False
    touching = change[heights < settings.touching * spacing + noise]
    on_plane = segment[plane.distance(segment) <= noise]
    return int(plane.near(touching, on_plane, settings.adjacent * spacing).sum()) >= settings.least_touching
