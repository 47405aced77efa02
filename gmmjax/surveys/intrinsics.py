"""The pinhole model of a depth camera."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int64

from gmmjax.errors import InputError

MIN_PIXELS = 16
# How far (standard deviation, in pixels) points may be from where a pinhole camera would see them.
PINHOLE_TOLERANCE = 2.0


@dataclass(frozen=True)
class Intrinsics:
    """A pinhole camera without distortion; x right, y down, z forward, pixel centres at whole numbers.

    Attributes:
        fx: focal length across, pixels.
        fy: focal length down, pixels.
        cx: column of the optical axis.
        cy: row of the optical axis.
        width: columns of the image.
        height: rows of the image.

    Raises:
        InputError: lengths that are not positive and finite, or an axis outside of the image.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        numbers = np.array([self.fx, self.fy, self.cx, self.cy], float)
        if not (np.isfinite(numbers).all() and min(self.fx, self.fy, self.width, self.height) > 0):
            raise InputError(
                f"intrinsics: fx={self.fx}, fy={self.fy}, cx={self.cx}, cy={self.cy}, width={self.width}, "
                f"height={self.height}: focal lengths and the image's size must be positive, in pixels"
            )
        if not (0 <= self.cx < self.width and 0 <= self.cy < self.height):
            raise InputError(
                f"intrinsics: the optical axis ({self.cx}, {self.cy}) lies outside of an image of {self.width} x "
                f"{self.height} pixels; give cx and cy in pixels of this image"
            )

    @classmethod
    def of_field_of_view(cls, field_of_view: tuple[float, float], width: int, height: int) -> "Intrinsics":
        """A camera that looks through the middle of its image.

        Args:
            field_of_view: full horizontal and vertical angle, degrees.
            width: columns of the image.
            height: rows of the image.
        """
        across, down = (np.tan(np.radians(angle) / 2) for angle in field_of_view)
        return cls(
            float(width / 2 / across), float(height / 2 / down), (width - 1) / 2, (height - 1) / 2, width, height
        )

    @classmethod
    def of_points(
        cls, points: Float64[np.ndarray, "n 3"], pixels: Int64[np.ndarray, " n"], width: int, height: int
    ) -> "Intrinsics":
        """The camera that saw points in these pixels, by least squares.

        Args:
            points: in the camera's coordinates.
            pixels: the index of each in the image, row by row.
            width: columns of the image.
            height: rows of the image.

        Raises:
            InputError: too few points, points behind the camera, or points that no pinhole camera sees in these pixels.
        """
        rows, columns = np.divmod(pixels, width)
        if len(points) < MIN_PIXELS or (points[:, 2] <= 0).any() or np.ptp(rows) == 0 or np.ptp(columns) == 0:
            raise InputError(
                f"intrinsics cannot be had from {len(points)} points: an ordered frame in its camera's coordinates "
                "(x right, y down, z forward, metres) is needed; give the intrinsics"
            )
        fx, cx = _line(points[:, 0] / points[:, 2], columns)
        fy, cy = _line(points[:, 1] / points[:, 2], rows)
        return cls(fx, fy, cx, cy, width, height)

    @property
    def field_of_view(self) -> tuple[float, float]:
        """Full horizontal and vertical angle about the optical axis that hold the image, degrees."""
        across = max(self.cx + 0.5, self.width - 0.5 - self.cx) / self.fx
        down = max(self.cy + 0.5, self.height - 0.5 - self.cy) / self.fy
        return float(2 * np.degrees(np.arctan(across))), float(2 * np.degrees(np.arctan(down)))

    def matrix(self) -> Float64[np.ndarray, "3 3"]:
        """The camera matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def rays(self) -> Float64[np.ndarray, "n 3"]:
        """The direction of every pixel, row by row, with z = 1."""
        x = (np.arange(self.width) - self.cx) / self.fx
        y = (np.arange(self.height) - self.cy) / self.fy
        return np.stack([*np.meshgrid(x, y), np.ones((self.height, self.width))], axis=-1).reshape(-1, 3)


def _line(tangents: Float[np.ndarray, " n"], pixels: Int64[np.ndarray, " n"]) -> tuple[float, float]:
    """Focal length and axis along one side of the image."""
    slope, start = np.polyfit(tangents, pixels, 1)
    error = float(np.std(pixels - slope * tangents - start))
    if not (slope > 0 and error < PINHOLE_TOLERANCE):
        raise InputError(
            "intrinsics: the points are not what a pinhole camera sees row by row, x right, y down, z forward "
            f"(off by {error:.1f} pixels); give the intrinsics, or points in the camera's own coordinates"
        )
    return float(slope), float(start)
