"""Depth images of a cloud: the nearest range in every direction from one place."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64
from scipy.ndimage import minimum_filter


@dataclasses.dataclass(frozen=True)
class DepthImageSettings:
    """The size of depth images and of their bins.

    Attributes:
        widest: largest field of view of one image, degrees; a wider one is split into the six faces of a cube, on which
            the angles atan(x / z) and atan(y / z) are nearly true to scale. Towards 180: bins at the rim are stretched.
        finest_bin: degrees; denser points share a bin of this size. Smaller: images of dense clouds need more memory.
        coarsest_bin: degrees; of nearer and sparser points the bins are smaller than their spacing, and a surface has
            holes. It is also the margin by which an image is wider than the view. Larger: a few near points occlude
            much of the view.
        sizes_per_octave: number of bin sizes for a factor of two. Fewer: bins are up to a whole factor larger than the
            spacing of the points asks for; more: the image takes longer to query.
        bin_per_spacing: size of a bin in spacings of its points. Below 1: bins on a surface are empty, and what is
            behind it seems visible.
    """

    widest: float = 110.0
    finest_bin: float = 0.25
    coarsest_bin: float = 4.0
    sizes_per_octave: int = 2
    bin_per_spacing: float = 1.2

    @property
    def margin(self) -> float:
        """By how much an image is wider than the view on each side, radians."""
        return float(np.radians(self.coarsest_bin))

    def bin_levels(self, angles: Float64[np.ndarray, " n"]) -> Int64[np.ndarray, " n"]:
        """The number of the smallest bin size, from 0 for the finest, that is at least as large as each angle."""
        finest, coarsest = np.radians(self.finest_bin), np.radians(self.coarsest_bin)
        octaves = np.log2(np.clip(angles, finest, coarsest) / finest)
        # What is of the size of a bin must not be put into the next larger one by rounding.
        return np.ceil(self.sizes_per_octave * octaves - 1e-9).astype(int)

    def bin_size(self, level: int) -> float:
        """The size of the bins of a level, radians."""
        return float(np.radians(self.finest_bin) * 2.0 ** (level / self.sizes_per_octave))


class Frustum(NamedTuple):
    """The part of space that one image shows.

    Attributes:
        rotation: axes of the image, as columns, in the coordinates of the view.
        half_angles: half the horizontal and half the vertical field of view, radians.
    """

    rotation: Float64[np.ndarray, "3 3"]
    half_angles: Float64[np.ndarray, " 2"]

    def project(
        self, points: Float64[np.ndarray, "n 3"], margin: float = 1e-9
    ) -> tuple[Int64[np.ndarray, " m"], Float64[np.ndarray, "m 2"], Float64[np.ndarray, " m"]]:
        """Projects points into the image.

        Args:
            points: in the coordinates of the view.
            margin: angle by which the image is wider on each side, radians; by default that of rounding, so that no
                point is lost between two faces of a cube.

        Returns:
            The indices of the points inside the image, their directions (radians) and their ranges.
        """
        x, y, z = self.rotation.T @ points.T
        limits = np.tan(np.minimum(self.half_angles + margin, np.pi / 2))
        inside = np.flatnonzero((z > 0) & (np.abs(x) <= limits[0] * z) & (np.abs(y) <= limits[1] * z))
        x, y, z = x[inside], y[inside], z[inside]
        angles = np.stack([np.arctan2(x, z), np.arctan2(y, z)], axis=1)
        return inside, angles, np.sqrt(x * x + y * y + z * z)


def frustums(field_of_view: tuple[float, float], settings: DepthImageSettings = DepthImageSettings()) -> list[Frustum]:
    """The images that show a view: one, or the six faces of a cube where the view is wide.

    Args:
        field_of_view: horizontal and vertical, degrees.
        settings: how wide one image is, at most.
    """
    if max(field_of_view) <= settings.widest:
        return [Frustum(np.eye(3), np.radians(np.array(field_of_view)) / 2)]
    x, y, z = np.eye(3)
    faces = [(x, y, z), (-z, y, x), (-x, y, -z), (z, y, -x), (x, -z, y), (x, z, -y)]
    return [Frustum(np.stack(face, axis=1), np.full(2, np.pi / 4)) for face in faces]


class _Resolution(NamedTuple):
    """The nearest point in each bin of one size, and the nearest range in it and the eight bins around; inf if none."""

    bin_size: float
    nearest: Int64[np.ndarray, "h w"]
    nearest_around: Float64[np.ndarray, "h w"]


class Nearest(NamedTuple):
    """Nearest ranges of an image in some directions.

    Attributes:
        point: the index of the nearest point in each direction, -1 where there is none.
        range: its range; inf where there is none.
        range_around: the nearest range in that direction and the bins around it.
    """

    point: Int64[np.ndarray, " n"]
    range: Float64[np.ndarray, " n"]
    range_around: Float64[np.ndarray, " n"]


class DepthImage(NamedTuple):
    """Nearest points by direction, at several resolutions: near points are sparse by angle and need larger bins.

    Attributes:
        half_angles: half the horizontal and half the vertical angle that the image covers, radians.
        members: the indices of the points that the image shows, and -1 last, for no point.
        ranges: of these points, and inf last.
        levels: from fine to coarse bins; each point of the cloud is in the one that fits its spacing.
    """

    half_angles: Float64[np.ndarray, " 2"]
    members: Int64[np.ndarray, " m"]
    ranges: Float64[np.ndarray, " m"]
    levels: tuple[_Resolution, ...]

    @classmethod
    def of(
        cls,
        points: Float64[np.ndarray, "n 3"],
        spacing: Float64[np.ndarray, " n"],
        frustum: Frustum,
        settings: DepthImageSettings = DepthImageSettings(),
    ) -> "DepthImage":
        """The image of points in the coordinates of a view.

        Args:
            points: x right, y down, z forward.
            spacing: distance of each point to its neighbours on the surface.
            frustum: what to show; the image is wider by a margin, so that the bins at the rim have neighbours.
            settings: the size of the bins.
        """
        inside, directions, ranges = frustum.project(points, settings.margin)
        half_angles = frustum.half_angles + settings.margin
        footprint = settings.bin_per_spacing * spacing[inside] / np.maximum(ranges, np.finfo(float).tiny)
        level = settings.bin_levels(footprint)
        levels = [
            _resolution(directions, ranges, np.flatnonzero(level == which), settings.bin_size(which), half_angles)
            for which in np.unique(level).tolist()
        ]
        return cls(half_angles, np.append(inside, -1), np.append(ranges, np.inf), tuple(levels))

    def nearest(self, directions: Float64[np.ndarray, "n 2"]) -> Nearest:
        """The nearest point in each direction.

        Args:
            directions: angles within the image, radians.
        """
        own = np.full(len(directions), len(self.members) - 1)
        around = np.full(len(directions), np.inf)
        for level in self.levels:
            row, column = _bins(directions, level.bin_size, self.half_angles).T
            there = level.nearest[row, column]
            own = np.where(self.ranges[there] < self.ranges[own], there, own)
            around = np.minimum(around, level.nearest_around[row, column])
        return Nearest(self.members[own], self.ranges[own], around)

    def around(self, directions: Float64[np.ndarray, "n 2"]) -> Int64[np.ndarray, "n l 9"]:
        """The nearest points in the bin of each direction and the eight around it, for each size of bins.

        Args:
            directions: angles within the image, radians.

        Returns:
            The indices of the points; -1 where a bin is empty.
        """
        found = np.full((len(directions), len(self.levels), 9), -1)
        down, right = (step.ravel() for step in np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"))
        for number, level in enumerate(self.levels):
            row, column = _bins(directions, level.bin_size, self.half_angles).T
            rows, columns = row[:, None] + down, column[:, None] + right
            height, width = level.nearest.shape
            within = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
            there = level.nearest[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
            found[:, number] = np.where(within, self.members[there], -1)
        return found


def _bins(
    directions: Float64[np.ndarray, "n 2"], bin_size: float, half_angles: Float64[np.ndarray, " 2"]
) -> Int64[np.ndarray, "n 2"]:
    return ((directions + half_angles) / bin_size).astype(np.int64)


def _resolution(
    directions: Float64[np.ndarray, "n 2"],
    ranges: Float64[np.ndarray, " n"],
    chosen: Int64[np.ndarray, " m"],
    bin_size: float,
    half_angles: Float64[np.ndarray, " 2"],
) -> _Resolution:
    """The chosen points in bins of one size; a bin without one has the number of all points."""
    shape = _bins(half_angles[None], bin_size, half_angles)[0] + 1
    row, column = _bins(directions[chosen], bin_size, half_angles).T
    bins = row * shape[1] + column
    nearest = np.full(shape, np.inf)
    np.minimum.at(nearest.reshape(-1), bins, ranges[chosen])
    first = ranges[chosen] == nearest.reshape(-1)[bins]
    points = np.full(shape, len(ranges))
    points.reshape(-1)[bins[first]] = chosen[first]
    return _Resolution(bin_size, points, minimum_filter(nearest, size=3, mode="constant", cval=np.inf))
