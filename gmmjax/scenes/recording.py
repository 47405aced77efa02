"""What one survey of a scene recorded: where the points seem to be, where they really are, and what they belong to."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.clouds import SensorViews, voxel_grid, voxel_size_for
from gmmjax.geometry import transformed
from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.pose_errors import PoseErrors
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.visibility import seen


@dataclasses.dataclass(frozen=True, eq=False)
class Recording:
    """One survey.

    Attributes:
        points: as recorded, poses' errors included [n, 3], metres.
        places: where they were measured in truth, noise included [n, 3].
        labels: of the solids that they belong to.
        views: where the sensor believed to stand.
        stands: where it stood.
        least_elevation: a turning scanner does not measure lower than this, degrees.
    """

    points: Float[np.ndarray, "n 3"]
    places: Float[np.ndarray, "n 3"]
    labels: Int[np.ndarray, " n"]
    views: SensorViews
    stands: SensorViews
    least_elevation: float = -90.0

    def chosen(self, rows: Bool[np.ndarray, " n"] | Int[np.ndarray, " m"]) -> "Recording":
        """With these points alone."""
        return dataclasses.replace(self, points=self.points[rows], places=self.places[rows], labels=self.labels[rows])

    def thinned(self, most: int, random: np.random.Generator) -> "Recording":
        """With so many points at most, drawn at random."""
        if len(self.points) <= most:
            return self
        return self.chosen(np.sort(random.choice(len(self.points), most, replace=False)))

    def fused(self, voxel: float) -> "Recording":
        """The means of the points in voxels; each belongs to what most of its points belong to.

        Args:
            voxel: edge length of the voxels, metres.
        """
        grid = voxel_grid(self.points, voxel)
        numbers = np.unique(self.labels)
        count = len(grid.mass)
        votes = [np.bincount(grid.voxel_of_point, self.labels == number, minlength=count) for number in numbers]
        sums = [np.bincount(grid.voxel_of_point, axis, minlength=count) for axis in self.places.T]
        return dataclasses.replace(
            self,
            points=grid.points,
            places=np.stack(sums, axis=1) / grid.mass[:, None],
            labels=numbers[np.argmax(votes, axis=0)],
        )

    def fused_to(self, most: int) -> "Recording":
        """Fused in voxels of the size that leaves about so many points, where it has more."""
        if len(self.points) <= most:
            return self
        return self.fused(voxel_size_for(self.points, most))

    def saw(
        self, places: Float[np.ndarray, "m 3"], solids: Sequence[Solid], hidden_by: float
    ) -> Bool[np.ndarray, " m"]:
        """Which places lie in the free space or on the surfaces that the survey observed.

        Args:
            places: in true coordinates, metres.
            solids: of the scene at the time of the survey.
            hidden_by: a place is occluded when the first hit on its ray is nearer by more than this, metres.
        """
        return seen(places, solids, self.stands, hidden_by=hidden_by, least_elevation=self.least_elevation)


def recorded_frames(
    camera: DepthCamera,
    solids: Sequence[Solid],
    poses: Float[np.ndarray, "v 4 4"],
    random: np.random.Generator,
    errors: PoseErrors = PoseErrors(),
) -> Recording:
    """The frames of a depth camera, one beside the other in one cloud."""
    believed = errors.believed(poses, random)
    frames = [camera.frame(solids, pose, random) for pose in poses]
    return joined(frames, poses, believed, camera.field_of_view, camera.max_range)


def joined(
    frames: Sequence[tuple[Float[np.ndarray, "_ 3"], Int[np.ndarray, " _"]]],
    poses: Float[np.ndarray, "v 4 4"],
    believed: Float[np.ndarray, "v 4 4"],
    field_of_view: tuple[float, float],
    max_range: float,
    least_elevation: float = -90.0,
) -> Recording:
    """The recording of a sensor that measured once from each pose.

    Args:
        frames: points in true coordinates, and labels, of each pose.
        poses: where the sensor stood.
        believed: where it believed to stand: its points are displaced with it.
        field_of_view: full horizontal and vertical angle, degrees.
        max_range: of the sensor, metres.
        least_elevation: a turning scanner does not measure lower than this, degrees.
    """
    displaced = [
        transformed(points, there @ np.linalg.inv(pose))
        for (points, _), pose, there in zip(frames, poses, believed, strict=True)
    ]
    return Recording(
        np.concatenate(displaced),
        np.concatenate([points for points, _ in frames]),
        np.concatenate([labels for _, labels in frames]),
        SensorViews(believed, field_of_view, max_range),
        SensorViews(poses, field_of_view, max_range),
        least_elevation,
    )
