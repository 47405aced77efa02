"""Maps of localised frames: the points of each frame, moved by its pose (thesis 3.1.5)."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64, Int64

from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.placed_frames import FrameMap, PlacedFrames, Sight, cropped
from gmmjax.surveys.pose_refinement import refined_poses
from gmmjax.surveys.trajectory import MAX_GAP, Trajectory


@dataclass(frozen=True, eq=False)
class LocalisedMap(FrameMap):
    """Frames laid together in the world.

    Attributes:
        frame_of_point: the index of the frame that each point is from, in `times` and `poses`.
        refined: whether the poses were refined; they are not where that would not lay the frames closer together.
    """

    frame_of_point: Int64[np.ndarray, " n"]
    refined: bool


def localised_map(
    frames: Iterable[Frame],
    trajectory: Trajectory,
    *,
    bounds: npt.ArrayLike | None = None,
    refine: bool = False,
    max_gap: float = MAX_GAP,
    max_range: float | None = None,
) -> LocalisedMap:
    """The points of frames in the world, by the pose at the time of each.

    The frames are taken one after the other; only the points that the map keeps are held.

    Args:
        frames: in the coordinates of their sensor.
        trajectory: of the sensor, as from `Trajectory.of_sensor`.
        bounds: lowest and highest corner [2, 3] of the box that the map is cropped to, metres in the world.
        refine: whether to move the frames a little so that they fit together, by point-to-plane ICP.
        max_gap: a frame between two poses further apart than this (seconds) is left out.
        max_range: of the sensor, metres; points beyond are left out. None: just beyond the farthest point.

    Raises:
        InputError: no frame is covered by the trajectory, or no point is in the bounds and in range.
    """
    cropped(np.zeros((0, 3)), bounds)
    placed, sight = PlacedFrames(frames, trajectory, max_gap=max_gap), Sight(max_range)
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
    frame_of_point = np.repeat(np.arange(len(clouds), dtype=np.int64), [len(cloud) for cloud in clouds])
    times, views = np.array(placed.times), sight.views(poses)
    return LocalisedMap(points, times, poses, views, placed.skipped, frame_of_point, poses is not given)


def _inside(
    points: Float64[np.ndarray, "n 3"], pose: Float64[np.ndarray, "4 4"], bounds: npt.ArrayLike | None
) -> Float64[np.ndarray, "k 3"]:
    """The points of a frame in the world, those that are in the bounds."""
    moved = transformed(points, pose)
    return moved[cropped(moved, bounds)]
