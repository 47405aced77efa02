"""Frames with their poses: what every map is made of."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Float64

from gmmjax.clouds import MARGIN, SensorViews, crop_box
from gmmjax.errors import InputError
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.trajectory import MAX_GAP, Trajectory

WHOLE_TURN, NEARLY_UPRIGHT = 360.0, 179.9


@dataclass(frozen=True, eq=False)
class FrameMap:
    """A map made of frames.

    Attributes:
        points: metres in the world.
        times: of the frames used, seconds.
        poses: of the sensor at these times, sensor to world.
        views: where the sensor stood and what it could see.
        frames_skipped: how many frames the map could not be made of: without points, or not covered by the trajectory.
    """

    points: Float64[np.ndarray, "n 3"]
    times: Float64[np.ndarray, " v"]
    poses: Float64[np.ndarray, "v 4 4"]
    views: SensorViews
    frames_skipped: int

    @property
    def frames_used(self) -> int:
        """Number of frames that the map is made of."""
        return len(self.times)


class PlacedFrames:
    """The frames that a trajectory covers, one after the other; it counts them, and those left out.

    Attributes:
        times: of the frames used, seconds.
        poses: sensor to world, of the same frames.
        skipped: how many frames could not be used: without points, or not covered by the trajectory.
    """

    def __init__(self, frames: Iterable[Frame], trajectory: Trajectory, *, max_gap: float = MAX_GAP) -> None:
        """Take the frames as they come; nothing is read before the iteration.

        Args:
            frames: in the coordinates of their sensor.
            trajectory: of the sensor.
            max_gap: a frame between two poses further apart than this (seconds) is not covered.
        """
        self._frames, self._trajectory, self._max_gap = frames, trajectory, max_gap
        self._span = (np.inf, -np.inf)
        self.times: list[float] = []
        self.poses: list[Float64[np.ndarray, "4 4"]] = []
        self.skipped = 0

    def __iter__(self) -> Iterator[tuple[Frame, Float64[np.ndarray, "4 4"]]]:
        """Each frame that has points and is covered, with its pose.

        Raises:
            InputError: at the end, where there was none.
        """
        for frame in self._frames:
            self._span = (min(self._span[0], frame.time), max(self._span[1], frame.time))
            poses, covered = self._trajectory.at([frame.time], self._max_gap)
            if not covered[0] or not len(frame.cloud):
                self.skipped += 1
                continue
            self.times.append(frame.time)
            self.poses.append(poses[0])
            yield frame, poses[0]
        if not self.times:
            raise self._none_left()

    def _none_left(self) -> InputError:
        if not self.skipped:
            return InputError("there are no frames to make a map of; check the topic and the times")
        first, last = (float(self._trajectory.times[index]) for index in (0, -1))
        return InputError(
            f"none of {self.skipped} frames can be used: they are from {self._span[0]:.3f} to {self._span[1]:.3f} s, "
            f"the {len(self._trajectory)} poses from {first:.3f} to {last:.3f} s, and a frame needs a pose before and "
            f"one after it, at most {self._max_gap} s apart; check that both have the same clock, or allow a longer gap"
        )


class Sight:
    """The sight of a sensor, told by its frames: the widest field of view, and the range of the farthest point."""

    def __init__(self, max_range: float | None) -> None:
        """Take what is known of the sensor.

        Args:
            max_range: metres. None: just beyond the farthest point.

        Raises:
            InputError: a range that is not positive.
        """
        if max_range is not None and not max_range > 0:
            raise InputError(f"max_range={max_range} must be positive, in metres")
        self._max_range = max_range
        self._widest, self._farthest = (0.0, 0.0), 0.0

    def of(self, frame: Frame) -> Bool[np.ndarray, " n"]:
        """Mask of the points of a frame in range; the field of view is widened to hold them."""
        ranges = np.linalg.norm(frame.cloud.points, axis=1)
        near = ranges <= (self._max_range or np.inf)
        if near.any():
            self._farthest = max(self._farthest, float(ranges[near].max()))
            horizontal, vertical = _field_of_view(frame)
            self._widest = (max(self._widest[0], horizontal), max(self._widest[1], vertical))
        return near

    def views(self, poses: Float64[np.ndarray, "v 4 4"]) -> SensorViews:
        """The views from these poses, sensor to world, after all frames."""
        return SensorViews(poses, self._widest, self._max_range or self._farthest * MARGIN)


def _field_of_view(frame: Frame) -> tuple[float, float]:
    """Angles of the pinhole camera that took the frame; else those that hold its points, as in `SensorViews`."""
    if frame.width is not None:
        try:
            return frame.intrinsics().field_of_view
        except InputError:
            pass
    points = frame.cloud.points
    if (points[:, 2] > 0).all():
        return SensorViews.at_origin(points).field_of_view
    x, y, z = points.T
    vertical = 2 * float(np.degrees(np.abs(np.arctan2(y, np.hypot(x, z))).max())) * MARGIN
    return WHOLE_TURN, min(vertical, NEARLY_UPRIGHT)


def cropped(points: Float64[np.ndarray, "n 3"], bounds: npt.ArrayLike | None) -> Bool[np.ndarray, " n"]:
    """Mask of the points in a box; all where there is none.

    Args:
        points: in the world.
        bounds: the lowest and the highest corner [2, 3], or None.

    Raises:
        InputError: bounds that are no box.
    """
    if bounds is None:
        return np.ones(len(points), bool)
    if np.shape(bounds) != (2, 3):
        raise InputError(f"bounds={bounds!r} must be the lowest and the highest corner [2, 3], metres in the world")
    return crop_box(points, *np.asarray(bounds))
