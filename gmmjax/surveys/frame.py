"""One frame of a depth sensor."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64

from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.surveys.intrinsics import Intrinsics


@dataclass(frozen=True, eq=False)
class Frame:
    """The points that a depth sensor saw at one time, in its own axes; a camera's are x right, y down, z forward.

    Attributes:
        cloud: the points with a return; of an ordered frame `cloud.rows` are their pixels, row by row.
        time: seconds, since 1970 or since any start that the poses share.
        name: of the sensor's coordinates ("frame_id"); may be empty.
        width: columns of an ordered frame, None where the points are in no order.
        height: its rows, or None.

    Raises:
        InputError: a size that does not fit the points, or a time that is not finite.
    """

    cloud: PointCloud
    time: float
    name: str = ""
    width: int | None = None
    height: int | None = None

    def __post_init__(self) -> None:
        if not np.isfinite(self.time):
            raise InputError(f"frame: time={self.time} must be seconds")
        pixels = len(self.cloud) + self.cloud.rows_dropped
        if (self.width is None) != (self.height is None) or (
            self.width is not None and self.height is not None and self.width * self.height != pixels
        ):
            raise InputError(f"frame: {self.width} x {self.height} does not fit a cloud of {pixels} rows")

    @classmethod
    def of_image(cls, points: npt.ArrayLike, time: float, name: str = "") -> "Frame":
        """An ordered frame.

        Args:
            points: coordinates [height, width, 3], NaN where a pixel has no return.
            time: seconds.
            name: of the sensor's coordinates.

        Raises:
            InputError: another shape.
        """
        image = np.asarray(points)
        if image.ndim != 3 or image.shape[2] != 3:
            raise InputError(f"frame: an ordered frame has points [height, width, 3], not {list(image.shape)}")
        height, width = image.shape[:2]
        return cls(PointCloud.from_rows(image.reshape(-1, 3)), time, name, width, height)

    def image(self) -> Float64[np.ndarray, "h w 3"]:
        """The points of an ordered frame by pixel, NaN where there is no return.

        Raises:
            InputError: the points are in no order.
        """
        if self.width is None or self.height is None:
            raise InputError("the frame's points are in no order; only an ordered frame (height above 1) is an image")
        image = np.full((self.height * self.width, 3), np.nan)
        image[self.cloud.rows] = self.cloud.points
        return image.reshape(self.height, self.width, 3)

    def depth_image(self) -> Float64[np.ndarray, "h w"]:
        """The depths of an ordered frame along its optical axis by pixel, NaN where there is no return.

        Raises:
            InputError: the points are in no order.
        """
        return self.image()[:, :, 2]

    def intrinsics(self) -> Intrinsics:
        """The pinhole camera that took an ordered frame, found from its points.

        Raises:
            InputError: the points are in no order, or no pinhole camera sees them so.
        """
        if self.width is None or self.height is None:
            raise InputError("the frame's points are in no order, so that its camera is not known; give the intrinsics")
        return Intrinsics.of_points(self.cloud.points, self.cloud.rows, self.width, self.height)
