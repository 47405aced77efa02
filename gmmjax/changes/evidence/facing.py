"""Which side of a surface was measured: another survey has not seen it from the other side."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from gmmjax.changes.evidence.scan_visibility import ScanVisibility


class Facing(NamedTuple):
    """To which side the surface at some places faces: that of the view that measured it.

    Attributes:
        normals: of the surface, towards that view; 0 where it is not known: the surface is not flat, or no view has it
            in its field of view and range, or it is seen edge-on.
        error: of the normals' directions, radians.
    """

    normals: Float64[np.ndarray, "n 3"]
    error: Float64[np.ndarray, " n"]

    @classmethod
    def of(cls, survey: ScanVisibility, rows: Int[np.ndarray, " n"]) -> "Facing":
        """To which side the surface of a survey faces at some of its points.

        The view that measured a point is taken to be the nearest one that has it in its field of view and range: the
        density of the points of a view falls with the square of the range.

        Args:
            survey: with its views; without them no side is known.
            rows: of its points.
        """
        points, finest = survey.points[rows], survey.sighted or survey
        nearest = finest.surface.nearest(points)
        error = finest.settings.tilts * finest.surface.tilts(nearest)
        towards = _cosines(finest.surface.normals[nearest], points, _measured_from(survey, points))
        known = finest.flat[nearest] & (np.abs(towards) > error)
        side = np.where(known, np.sign(towards), 0.0)
        return cls(side[:, None] * finest.surface.normals[nearest], error)

    def chosen(self, which: Int[np.ndarray, " m"]) -> "Facing":
        """Of some of the places."""
        return Facing(*(values[which] for values in self))

    def away(self, points: Float64[np.ndarray, "n 3"], position: Float64[np.ndarray, " 3"]) -> Bool[np.ndarray, " n"]:
        """Whether a sensor of another survey is on the other side of the surface.

        Args:
            points: the places.
            position: of the sensor.
        """
        return np.asarray(_cosines(self.normals, points, position) < -self.error)


def _measured_from(survey: ScanVisibility, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """The position of the nearest view that has each point in its field of view and range; the point itself: none."""
    positions, least = points.copy(), np.full(len(points), np.inf)
    for view in range(0 if survey.views is None else len(survey.views)):
        assert survey.views is not None
        in_camera = survey.views.in_camera(points, view)
        ranges = np.linalg.norm(in_camera, axis=1)
        nearer = survey.views.in_field_of_view(in_camera) & (ranges < least)
        positions[nearer], least[nearer] = survey.views.poses[view, :3, 3], ranges[nearer]
    return positions


def _cosines(
    normals: Float64[np.ndarray, "n 3"], points: Float64[np.ndarray, "n 3"], positions: Float64[np.ndarray, "*n 3"]
) -> Float64[np.ndarray, " n"]:
    """Of the angles between the normals and the directions from the places to a sensor, or one for each."""
    towards = positions - points
    lengths = np.maximum(np.linalg.norm(towards, axis=1), np.finfo(np.float64).tiny)
    return np.asarray((normals * towards).sum(axis=1) / lengths)
