"""Without sensor poses: which changes are only the support plane of a change in the other cloud.

An object occludes the shelf that it stands on, and what lies in its shadow. When the object goes, the shelf appears;
when it comes, the shelf disappears. But what stands on a surface shows that the surface is there.
"""

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.clouds import voxel_grid
from gmmjax.geometry import (
    Contact,
    Plane,
    PlaneSettings,
    UpwardSettings,
    evenly_chosen,
    plane_surface,
    planes_of,
    points_within,
    upward_direction,
)
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class SupportSettings:
    """When a segment is the support plane of a segment of the other cloud. Lengths in spacings, where they say so.

    Attributes:
        planes: how the plane of a support is found; one plane must hold `planes.min_share` of its voxels. Lower:
            boxes are taken for supports of what stands against them.
        voxel: edge of those voxels, in spacings, so that the number of a plane's inliers measures an area. Smaller:
            dense parts of a segment outweigh large ones.
        noise_deviations: largest distance of an inlier from the plane, in standard deviations of the segment's noise.
            Smaller: noisy supports are not flat.
        min_flatness: the same, in spacings, at least, where the surface is without noise. 0: only rounding is allowed
            for.
        max_below: fraction of an object's points below its support plane, at most: outliers. 1: what reaches through
            the plane stands on it.
        touching: height above the plane, in spacings, within which points of an object touch it. Smaller: objects whose
            lowest points pass for unchanged do not touch it; larger: objects that hang above it do.
        min_touching: number of such points that have a point of the support next to them along the plane, at least.
            0: every object above the infinite plane stands on it.
        adjacent: distance along the plane, in spacings, at which these have it. Larger: objects next to a support stand
            on it.
        upward: when there is an upward direction, across which supports are.
        around: distance, in spacings, within which unchanged surfaces around the segments tell that direction. Smaller:
            the normals beside an object are mixed with those of its sides.
        max_touching: number of a segment's points, at most and evenly chosen, from which that distance is taken: a
            bound on the time.
    """

    planes: PlaneSettings = PlaneSettings(min_share=0.75)
    voxel: float = 2.0
    noise_deviations: float = 3.0
    min_flatness: float = 0.5
    max_below: float = 0.03
    touching: float = 3.0
    min_touching: int = 8
    adjacent: float = 5.0
    upward: UpwardSettings = UpwardSettings()
    around: float = 10.0
    max_touching: int = 300


def supports(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    labels: Pair[Int[np.ndarray, " _"]],
    spacing: float,
    settings: SupportSettings = SupportSettings(),
) -> Pair[Bool[np.ndarray, " _"]]:
    """The points of the segments of either cloud that a segment of the other cloud stands on.

    Of two flat segments that could stand on each other neither is taken for a support. What is not level, or not
    beneath, supports nothing; where there is no upward direction, nothing does.

    Args:
        points: of both clouds.
        labels: -1, or the number of the segment that a point belongs to.
        spacing: distance of neighbouring points on a surface.
        settings: when a segment is a support.
    """
    up = _upward(points, labels, spacing, settings)
    if up is None:
        return labels.map(lambda own: np.zeros(len(own), bool))
    segments = each(lambda own, label: _segments(own, label, up, spacing, settings), points, labels)
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
        up: the upward direction.
        spacing: distance of neighbouring points on a surface.
        settings: when a segment is a support.
    """

    points: Float64[np.ndarray, "n 3"]
    up: Float64[np.ndarray, " 3"]
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
        """Whether it is flat and level, and a change of the other cloud stands on it."""
        reach = (self.settings.adjacent + self.settings.touching) * self.spacing
        (lower, upper), (least, greatest) = self.bounds, change.bounds
        if (least > upper + reach).any() or (greatest < lower - reach).any():
            return False
        plane, noise = self.plane
        if plane is None or abs(plane.normal @ self.up) < self.settings.upward.level:
            return False
        sense = np.sign(plane.normal @ self.up)
        upward = Plane(sense * plane.normal, sense * plane.offset)
        return _stands_on(change.points, self.points, upward, noise, self.spacing, self.settings)


def _segments(
    points: np.ndarray, labels: np.ndarray, up: np.ndarray, spacing: float, settings: SupportSettings
) -> dict[int, _Segment]:
    return {
        int(label): _Segment(points[labels == label], up, spacing, settings) for label in np.unique(labels[labels >= 0])
    }


def _upward(
    points: Pair[Float64[np.ndarray, "_ 3"]],
    labels: Pair[Int[np.ndarray, " _"]],
    spacing: float,
    settings: SupportSettings,
) -> Float64[np.ndarray, " 3"] | None:
    """The upward direction, by the unchanged surfaces of both clouds that the segments touch."""
    unchanged = np.concatenate([*each(lambda own, label: own[label < 0], points, labels)])
    if not len(unchanged):
        return None
    segments = [
        own[label == number]
        for own, label in zip(points, labels, strict=True)
        for number in np.unique(label[label >= 0])
    ]
    return upward_direction([_contact(own, unchanged, spacing, settings) for own in segments], settings.upward)


def _contact(
    segment: Float64[np.ndarray, "n 3"],
    unchanged: Float64[np.ndarray, "u 3"],
    spacing: float,
    settings: SupportSettings,
) -> Contact:
    """The unchanged surfaces around a segment."""
    tree = cKDTree(segment[evenly_chosen(len(segment), settings.max_touching)])
    # Thinned, so that the planes of the voxels are larger than the noise and what the two clouds are off by.
    around = voxel_grid(points_within(tree, unchanged, settings.around * spacing), settings.voxel * spacing).points
    if not len(around):
        return Contact(np.zeros((0, 3)), np.zeros(3))
    return Contact(plane_surface(around, settings.planes).normals, segment.mean(axis=0) - around.mean(axis=0))


def _support_plane(
    segment: Float64[np.ndarray, "n 3"], spacing: float, settings: SupportSettings
) -> tuple[Plane | None, float]:
    """The plane that most of a segment lies on, if there is one, and the largest deviation from it by noise."""
    noise = settings.noise_deviations * plane_surface(segment, settings.planes).thickness
    thinned = voxel_grid(segment, settings.voxel * spacing).points
    flatness = max(noise, settings.min_flatness * spacing)
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
    if (heights < -(noise + spacing)).mean() > settings.max_below:
        return False
    touching = change[heights < settings.touching * spacing + noise]
    on_plane = segment[plane.distance(segment) <= noise]
    return int(plane.near(touching, on_plane, settings.adjacent * spacing).sum()) >= settings.min_touching
