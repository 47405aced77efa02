"""From where a cloud is drawn: parallel projections, so that lengths on the page are lengths in the scan."""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from gmmjax.errors import check_choice
from gmmjax.reporting.camera import initial_camera

Direction = Literal["oblique", "above", "front", "side"]
DIRECTIONS: tuple[Direction, ...] = ("oblique", "above", "front", "side")
AXES = ("x", "y", "z")


class Projection(NamedTuple):
    """A parallel projection: unit vectors to the right on the page, upwards on it and out of it.

    Attributes:
        names: of the axes to the right and upwards; None where they are not along axes of the clouds.
    """

    right: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    towards_eye: Float[np.ndarray, "3"]
    names: tuple[str, str] | None

    @classmethod
    def of(cls, direction: Direction, points: Float[np.ndarray, "n 3"]) -> "Projection":
        """Look from "oblique" (as the report at first), "above", "front" or "side"; the points tell what is up."""
        check_choice("direction", direction, DIRECTIONS)
        camera = initial_camera(points)
        if direction == "oblique":
            right, up, towards_eye = camera.axes
            return cls(right, up, towards_eye, None)
        up = camera.up
        # A depth camera looks along z, and y is up or down; else z is up.
        forward = np.array([0.0, 1.0, 0.0]) if up[2] else np.array([0.0, 0.0, -up[1]])
        right = np.cross(forward, up)
        pages = {"above": (right, forward), "front": (right, up), "side": (forward, up)}
        across, upwards = pages[direction]
        return cls(across, upwards, np.cross(across, upwards), (_name(across), _name(upwards)))

    def on_page(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """Return where points are on the page, in the unit of the clouds."""
        return points @ np.stack([self.right, self.up], axis=1)

    def covariance_on_page(self, covariance: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n 2 2"]:
        """Return the covariance of the projected points."""
        axes = np.stack([self.right, self.up])
        return axes @ covariance @ axes.T


def _name(axis: Float[np.ndarray, "3"]) -> str:
    """Name an axis of the clouds, with a minus where it points the other way."""
    place = int(np.abs(axis).argmax())
    return f"{'−' if axis[place] < 0 else ''}{AXES[place]}"
