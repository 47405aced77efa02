"""The coordinates of a LAS file: integers with a scale and an offset for each axis."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int32

from gmmjax.clouds.cloud_file import Bounds
from gmmjax.clouds.las_header import LasHeader
from gmmjax.errors import InputError

LARGEST = 2**31 - 1


class BoundsError(InputError):
    """Points lie outside the bounds that were declared for them."""


class CoordinateEncoding(NamedTuple):
    """How coordinates become integers (LAS 1.4 R15, section 2.6: x = X · scale + offset).

    Attributes:
        scales: of x, y and z.
        offsets: of x, y and z.
        kept: whether these are the file's own.
    """

    scales: Float64[np.ndarray, "3"]
    offsets: Float64[np.ndarray, "3"]
    kept: bool

    @classmethod
    def of_file(cls, header: LasHeader) -> "CoordinateEncoding":
        """The file's own.

        Args:
            header: of the file.
        """
        return cls(header.scales, header.offsets, True)

    @classmethod
    def for_bounds(cls, header: LasHeader, bounds: Bounds) -> "CoordinateEncoding":
        """The file's own where it can represent the points in a box; else another, as like it as can be.

        Args:
            header: of the file.
            bounds: of the points.
        """
        own, (low, high) = cls.of_file(header), bounds
        if own.represents(bounds).all():
            return own
        with np.errstate(over="ignore", invalid="ignore"):
            centre = low / 2 + high / 2
            offsets = np.rint(centre / own.scales) * own.scales
        offsets = np.where(np.isfinite(offsets), offsets, centre)
        least = np.maximum(high / 2 - low / 2, np.finfo(float).tiny) / (LARGEST - 1)
        coarser = 10.0 ** np.ceil(np.log10(least))
        recentred = cls(own.scales, offsets, False)
        return recentred._replace(scales=np.where(recentred.represents(bounds), own.scales, coarser))

    def represents(self, bounds: Bounds) -> Bool[np.ndarray, "3"]:
        """For each axis whether it can represent all points in a box.

        Args:
            bounds: of the points.
        """
        with np.errstate(over="ignore"):
            furthest = np.maximum(*(np.abs((edge - self.offsets) / self.scales) for edge in bounds))
        return np.asarray(furthest < LARGEST)

    def integers(
        self, points: Float64[np.ndarray, "n 3"], of_file: Int32[np.ndarray, "n 3"], unmoved: Bool[np.ndarray, " n"]
    ) -> Int32[np.ndarray, "n 3"]:
        """The integers of points; of unmoved ones the file's, where its scale and offset are kept.

        Args:
            points: where they are now.
            of_file: their integers in the file.
            unmoved: which points are where the file has them.

        Raises:
            BoundsError: there are none for a point.
        """
        whole = np.rint((points - self.offsets) / self.scales)
        if self.kept:
            whole[unmoved] = of_file[unmoved]
        if whole.min() < -LARGEST - 1 or whole.max() > LARGEST:
            raise BoundsError("points lie outside the bounds that were declared for them")
        return np.ascontiguousarray(whole.astype("<i4"))
