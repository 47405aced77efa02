"""Maps of localised frames: the points of every n-th frame, moved by its pose (thesis 3.1.5)."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64, Int64

from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.placed_frames import PlacedFrames, Sight, cropped
from gmmjax.surveys.pose_refinement import refined_poses
from gmmjax.surveys.trajectory import MAX_GAP, Trajectory


@dataclass(frozen=True, eq=False)
class LocalisedMap:
    """Frames laid together in the world.

    Attributes:
        points: of all frames, metres in the world.
        frame_of_point: the index of the frame that each is from, in `times` and `poses`.
        times: of the frames used, seconds.
        poses: of the sensor at these times, sensor to world, after the refinement.
        views: where the sensor stood and what it could see.
        frames_used: how many frames the map is made of.
        frames_skipped: how many it could not be made of: without points, or not covered by the trajectory.
        refined: whether the poses were refined; they are not where that would not lay the frames closer together.
    """

    points: Float64[np.ndarray, "n 3"]
    frame_of_point: Int64[np.ndarray, " n"]
    times: Float64[np.ndarray, " v"]
    poses: Float64[np.ndarray, "v 4 4"]
    views: SensorViews
    frames_used: int
    frames_skipped: int
    refined: bool


def localised_map(
    frames: Iterable[Frame],
    trajectory: Trajectory,
    *,
    every: int = 1,
    bounds: npt.ArrayLike | None = None,
    refine: bool = False,
    max_gap: float = MAX_GAP,
    field_of_view: tuple[float, float] | None = None,
    max_range: float | None = None,
) -> LocalisedMap:
    """The points of every n-th frame in the world, by the pose at its time.

    The frames are taken one after the other; only the points that the map keeps are held.

    Args:
        frames: in the coordinates of their sensor.
        trajectory: of the sensor, as from `Trajectory.of_sensor`.
        every: use one frame of this number.
        bounds: lowest and highest corner [2, 3] of the box that the map is cropped to, metres in the world.
        refine: whether to move the frames a little so that they fit together (iterated closest points along the
            normals of the others).
        max_gap: a frame between two poses further apart than this (seconds) is left out.
        field_of_view: of the sensor, full horizontal and vertical angle in degrees. None: that of the frames.
        max_range: of the sensor, metres; points beyond are left out. None: just beyond the farthest point.

    Raises:
        InputError: no frame is covered by the trajectory, or no point is in the bounds and in range.
    """
    cropped(np.zeros((0, 3)), bounds)
    placed = PlacedFrames(frames, trajectory, every=every, max_gap=max_gap)
    sight = Sight(field_of_view, max_range)
    clouds: list[Float64[np.ndarray, "k 3"]] = []
    for frame, pose in placed:
        seen = frame.cloud.points[sight.of(frame)]
        # Refinement needs what the sensor saw; else only what the map keeps is held.
        clouds.append(seen if refine else _inside(seen, pose, bounds))
    given = poses = np.stack(placed.poses)
    if refine:
        poses = refined_poses(clouds, given)
        clouds = [_inside(seen, pose, bounds) for seen, pose in zip(clouds, poses, strict=True)]
    points = np.concatenate(clouds)
    if not len(points):
        raise InputError(f"none of the {len(given)} frames has a point in the bounds and in range; check both")
    return LocalisedMap(
        points=points,
        frame_of_point=np.repeat(np.arange(len(clouds), dtype=np.int64), [len(cloud) for cloud in clouds]),
        times=np.array(placed.times),
        poses=poses,
        views=sight.views(poses),
        frames_used=len(clouds),
        frames_skipped=placed.skipped,
        refined=poses is not given,
    )


def _inside(
    points: Float64[np.ndarray, "n 3"], pose: Float64[np.ndarray, "4 4"], bounds: npt.ArrayLike | None
) -> Float64[np.ndarray, "k 3"]:
    """The points of a frame in the world, those that are in the bounds."""
    moved = transformed(points, pose)
    return moved[cropped(moved, bounds)]
