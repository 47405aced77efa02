"""From where a cloud is looked at first."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

# A cloud whose points all lie in such a cone about the z axis, this near, is taken for a depth camera's: z forward and
# y down, as robots and photogrammetry have it, or z backward and y up, as OpenGL has it.
CAMERA_HALF_ANGLE = np.deg2rad(60)
CAMERA_RANGE = 20.0
TILT = np.deg2rad(25)
# Of the report's viewer: half its field of view from top to bottom; pictures may be narrower than high.
HALF_HEIGHT = np.tan(np.pi / 8)
HALF_WIDTH = 0.85 * HALF_HEIGHT


class PlotCamera(NamedTuple):
    """A view: unit vectors towards the eye, from the middle of the cloud, and upwards on the screen."""

    towards_eye: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Unit vectors, as rows: to the right on the screen, upwards on it, and towards the eye."""
        across = _unit(np.cross(self.up, self.towards_eye))
        return np.stack([across, np.cross(self.towards_eye, across), self.towards_eye])

    def framed(
        self,
        points: Float[np.ndarray, "n 3"],
        shown: Float[np.ndarray, "m 3"] = np.empty((0, 3)),
        half_width: float = HALF_WIDTH,
    ) -> tuple[Float[np.ndarray, "3"], float]:
        """Choose what to look at, and from how far, so that all but the outermost hundredth of the points are in view.

        Args:
            points: what is looked at, near the origin.
            shown: points that must not be among that hundredth.
            half_width: of the view, at the distance 1 from the eye.

        Returns:
            The centre of the view, and the distance of the eye from it, which is positive even for a single point.
        """
        axes, half_sizes = self.axes, np.array([half_width, HALF_HEIGHT])
        centre, distance = np.zeros(3), 0.0
        for _ in range(3):
            seen, kept = ((cloud - centre) @ axes.T for cloud in (points, shown))
            outermost = np.quantile(_needed(seen, half_sizes), 0.99), *_needed(kept, half_sizes)
            distance = max(1.05 * float(max(outermost)), float(np.finfo(np.float32).tiny))
            for axis in (0, 1):
                inner = np.quantile(_slopes(seen, axis, distance), [0.01, 0.99])
                bounds = [*inner, *_slopes(kept, axis, distance)]
                centre = centre + axes[axis] * distance * (min(bounds) + max(bounds)) / 2
        return centre, distance


def initial_camera(points: Float[np.ndarray, "n 3"]) -> PlotCamera:
    """Look at a depth camera's cloud from beside the sensor; at others across the thinnest direction, z up. Metres."""
    for forward in (1, -1):
        # The two conventions differ by half a turn about x, and so do the views.
        turn = np.array([1, forward, forward])
        if _is_depth_camera(points * turn):
            return PlotCamera(turn * _unit(np.array([-0.15, -0.25, -1.0])), turn * np.array([0.0, -1.0, 0.0]))
    deviations = points - points.mean(axis=0)
    thinnest = np.linalg.eigh(deviations.T @ deviations)[1][:, 0]
    up = np.array([0.0, 0.0, 1.0])
    level = thinnest * [1, 1, 0]
    # Looking along z, at a floor or at terrain, any side will do.
    sideways = _unit(level) if np.linalg.norm(level) > 0.5 else _unit(np.array([1.0, -1.5, 0.0]))
    sideways = sideways if sideways @ [1.0, -1.5, 0.0] > 0 else -sideways
    height = TILT if np.linalg.norm(level) > 0.5 else 2 * TILT
    return PlotCamera(_unit(np.cos(height) * sideways + np.sin(height) * up), up)


def _is_depth_camera(points: Float[np.ndarray, "n 3"]) -> bool:
    """Tell whether a depth camera at the origin that looks along +z could have seen the points."""
    depth = points[:, 2]
    if not (depth > 0).all() or np.median(depth) > CAMERA_RANGE:
        return False
    return bool((np.hypot(points[:, 0], points[:, 1]) < depth * np.tan(CAMERA_HALF_ANGLE)).all())


def _unit(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    unit: Float[np.ndarray, 3] = vector / np.linalg.norm(vector)
    return unit


def _needed(seen: Float[np.ndarray, "n 3"], half_sizes: Float[np.ndarray, "2"]) -> Float[np.ndarray, " n"]:
    """Return how far the eye must be from the centre of the view to have each point in it."""
    needed: Float[np.ndarray, " n"] = np.max(np.abs(seen[:, :2]) / half_sizes, axis=1) + seen[:, 2]
    return needed


def _slopes(seen: Float[np.ndarray, "n 3"], axis: int, distance: float) -> Float[np.ndarray, " n"]:
    """Return how far beside the line of sight points are seen, for each unit of depth."""
    slopes: Float[np.ndarray, " n"] = seen[:, axis] / np.maximum(distance - seen[:, 2], 0.1 * distance)
    return slopes
