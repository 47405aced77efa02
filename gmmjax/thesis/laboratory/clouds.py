"""A survey of the laboratory as one point cloud, of the kinds of the thesis's data, with the thing of every point."""

import dataclasses
from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.clouds import SensorViews, voxel_grid
from gmmjax.errors import check_choice
from gmmjax.scenes import seen
from gmmjax.surveys import Frame, localised_map, volumetric_map
from gmmjax.thesis.laboratory.recording import Recording
from gmmjax.thesis.laboratory.runs import Laboratory

CloudKind = Literal["frame", "volumetric", "localised"]
# The kinds of clouds and their names in tables and figures.
CLOUD_KINDS: Mapping[CloudKind, str] = {
    "frame": "single frames",
    "volumetric": "volumetric maps",
    "localised": "localised maps",
}
# Leaf size of the voxel filter (thesis 3.1.6) and of the volumetric maps, metres.
VOXEL_SIZE = 0.01
# Nearest measured points that vote on the thing of a vertex of a volumetric map.
VOTERS = 5


@dataclasses.dataclass(frozen=True, eq=False)
class LabCloud:
    """A cloud of the laboratory.

    Attributes:
        points: metres, in the survey's coordinates.
        things: per point the label of the thing that it lies on (an index in `THINGS`); -1: on none.
        views: estimated poses and field of view of the camera.
        to_scene: rigid transform from the survey's coordinates to the true ones.
        laboratory: the laboratory that was surveyed.
        frame: the image of a single frame; None for maps.
    """

    points: Float64[np.ndarray, "n 3"]
    things: Int[np.ndarray, " n"]
    views: SensorViews
    to_scene: Float64[np.ndarray, "4 4"]
    laboratory: Laboratory
    frame: Frame | None = None

    def could_see(self, other: "LabCloud") -> Bool[np.ndarray, " m"]:
        """Which points of another cloud lie in space that this survey observed."""
        places = other.points @ other.to_scene[:3, :3].T + other.to_scene[:3, 3]
        return seen(places, self.laboratory.solids, self.views.moved(self.to_scene))


def lab_cloud(recording: Recording, kind: Literal["volumetric", "localised"]) -> LabCloud:
    """A map of one survey.

    Args:
        recording: of the survey.
        kind: "localised": the points of all frames by the robot's localisation, one for each voxel of 1 cm (thesis
            3.1.5); "volumetric": the vertices of the surface that all frames are fused to (3.1.4), which needs Open3D.

    Raises:
        InputError: an unknown kind, or Open3D is not installed.
    """
    check_choice("kind", kind, ("volumetric", "localised"))
    return _volumetric(recording) if kind == "volumetric" else _localised(recording)


def _localised(recording: Recording) -> LabCloud:
    merged = localised_map(recording.frames, recording.localised.of_sensor(recording.sensor_on_body))
    grid = voxel_grid(merged.points, VOXEL_SIZE)
    things = _majority(np.concatenate(recording.things), grid.voxel_of_point, len(grid.mass))
    return _cloud(recording, grid.points, things, merged.poses)


def _volumetric(recording: Recording) -> LabCloud:
    trajectory = recording.adjusted.of_sensor(recording.sensor_on_body)
    surface = volumetric_map(recording.frames, trajectory, voxel_size=VOXEL_SIZE)
    measured = localised_map(recording.frames, trajectory)
    neighbours = cKDTree(measured.points).query(surface.points, VOTERS)[1]
    vertices = np.repeat(np.arange(len(surface.points)), VOTERS)
    things = _majority(np.concatenate(recording.things)[neighbours.ravel()], vertices, len(surface.points))
    return _cloud(recording, surface.points, things, measured.poses)


def _cloud(
    recording: Recording,
    points: Float64[np.ndarray, "n 3"],
    things: Int[np.ndarray, " n"],
    poses: Float64[np.ndarray, "v 4 4"],
) -> LabCloud:
    views = SensorViews(poses, recording.camera.field_of_view, recording.camera.max_range)
    return LabCloud(points, things, views, np.linalg.inv(recording.misregistration), recording.laboratory)


def _majority(labels: Int[np.ndarray, " n"], group: Int[np.ndarray, " n"], groups: int) -> Int[np.ndarray, " g"]:
    """The most frequent label in each group."""
    numbers = np.unique(labels)
    votes = [np.bincount(group[labels == number], minlength=groups) for number in numbers]
    return numbers[np.argmax(votes, axis=0)]
