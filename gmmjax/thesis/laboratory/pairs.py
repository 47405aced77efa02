"""Surveys of the laboratory as clouds of the three kinds of the thesis, and as pairs with the truth of every point."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.clouds import SensorViews, load_open3d, voxel_grid
from gmmjax.errors import check_choice
from gmmjax.evaluation import LabelledCloud, LabelledPair, PairSource
from gmmjax.scenes import UNLABELLED, DepthCamera, looking_at, seen, uncounted
from gmmjax.surveys import localised_map, volumetric_map
from gmmjax.thesis.laboratory.recording import NOISE, START, Recording, frame_from, recorded_run
from gmmjax.thesis.laboratory.runs import ONE_TYPE, RUNS, THINGS, Laboratory, RunPair, laboratory_of, object_changes

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
# Single frames: horizontal distance of the camera from the object and its height, metres.
DISTANCE, EYE_HEIGHT = 1.3, 0.8
# Standard deviation between the two camera poses of a pair of single frames, metres.
POSE_DIFFERENCE = 0.01
# The camera stays within this distance of the room's middle on both horizontal axes, metres.
CAMERA_REACH = 0.75


@dataclasses.dataclass(frozen=True, eq=False)
class LabCloud:
    """A cloud of the laboratory.

    Attributes:
        points: metres, in the survey's coordinates.
        things: per point the label of the thing that it lies on (an index in `THINGS`); -1: on none.
        views: estimated poses and field of view of the camera.
        to_scene: rigid transform from the survey's coordinates to the true ones.
        laboratory: the laboratory that was surveyed.
    """

    points: Float64[np.ndarray, "n 3"]
    things: Int[np.ndarray, " n"]
    views: SensorViews
    to_scene: Float64[np.ndarray, "4 4"]
    laboratory: Laboratory

    def in_scene(self) -> Float64[np.ndarray, "n 3"]:
        """The points in true coordinates."""
        return np.asarray(self.points @ self.to_scene[:3, :3].T + self.to_scene[:3, 3])

    def could_see(self, other: "LabCloud") -> Bool[np.ndarray, " m"]:
        """Mask of the points of another cloud in space that this survey observed."""
        return seen(other.in_scene(), self.laboratory.solids, self.views.moved(self.to_scene))


def lab_cloud(recording: Recording, kind: Literal["volumetric", "localised"]) -> LabCloud:
    """Make a map of one survey.

    Args:
        recording: of the survey.
        kind: "localised": the points of all frames by the robot's localisation, one for each voxel of 1 cm (thesis
            3.1.5); "volumetric": the vertices of the surface that all frames are fused to (3.1.4), which needs Open3D.

    Raises:
        InputError: an unknown kind, or Open3D is not installed.
    """
    check_choice("kind", kind, ("volumetric", "localised"))
    body = recording.localised if kind == "localised" else recording.adjusted
    trajectory = body.of_sensor(recording.sensor_on_body)
    measured, labels = localised_map(recording.frames, trajectory), np.concatenate(recording.things)
    if kind == "localised":
        grid = voxel_grid(measured.points, VOXEL_SIZE)
        points, things = grid.points, _majority(labels, grid.voxel_of_point, len(grid.mass))
    else:
        points = volumetric_map(recording.frames, trajectory, voxel_size=VOXEL_SIZE).points
        neighbours = cKDTree(measured.points).query(points, VOTERS)[1]
        things = _majority(labels[neighbours.ravel()], np.repeat(np.arange(len(points)), VOTERS), len(points))
    views = SensorViews(measured.poses, recording.camera.field_of_view, recording.camera.max_range)
    return LabCloud(points, things, views, np.linalg.inv(recording.misregistration), recording.laboratory)


def lab_frames(runs: RunPair, seed: int) -> tuple[LabCloud, LabCloud]:
    """Take two frames of an object that changed from almost the same pose, each in its camera's coordinates."""
    random = np.random.default_rng([seed, *(RUNS.index(run) for run in runs)])
    before, after = (laboratory_of(run, seed) for run in runs)
    camera = DepthCamera(noise=random.uniform(*NOISE))
    target = _target(before, after, random)
    inward = -target[:2] / np.linalg.norm(target[:2])
    place = np.clip(target[:2] + DISTANCE * inward, -CAMERA_REACH, CAMERA_REACH) + 0.1 * random.standard_normal(2)
    views = SensorViews(np.eye(4)[None], camera.field_of_view, camera.max_range)
    clouds = []
    for laboratory in (before, after):
        position = np.array([*place, EYE_HEIGHT]) + POSE_DIFFERENCE / np.sqrt(3) * random.standard_normal(3)
        pose = looking_at(position, target + POSE_DIFFERENCE * random.standard_normal(3))
        frame, things = frame_from(laboratory, camera, pose, START, random)
        clouds.append(LabCloud(frame.cloud.points, things, views, pose, laboratory))
    return clouds[0], clouds[1]


def labelled(name: str, before: LabCloud, after: LabCloud) -> LabelledPair:
    """Label two clouds of one kind with the objects that changed between their laboratories.

    The truth of a point is -1, or the label of the object that changed; a moved object has the same in both clouds.
    Objects of which a cloud has almost no points that the other survey could observe are not counted in it.
    """
    changed = [THINGS.index(thing) for thing in object_changes(before.laboratory, after.laboratory)]
    sides = []
    for cloud, other in ((before, after), (after, before)):
        truth = np.where(np.isin(cloud.things, changed), cloud.things, UNLABELLED)
        unseen = ~other.could_see(cloud)
        solids = [solid for solid in cloud.laboratory.solids if solid.label in changed]
        few = uncounted(solids, truth, unseen)
        sides.append(LabelledCloud(cloud.points, truth, unseen, cloud.views, few, cloud.things))
    return LabelledPair(name, *sides)


def lab_pair(kind: CloudKind, runs: RunPair, seed: int) -> LabelledPair:
    """Simulate two runs of the laboratory as clouds of one kind, with the truth.

    Args:
        kind: of the clouds.
        runs: the one before and the one after.
        seed: of the places of the objects, the paths and the noise.

    Raises:
        InputError: an unknown kind or run; or volumetric maps without Open3D.
    """
    check_choice("kind", kind, tuple(CLOUD_KINDS))
    name = f"{runs[0]} to {runs[1]}, seed {seed}"
    if kind == "frame":
        return labelled(name, *lab_frames(runs, seed))
    return labelled(name, *(lab_cloud(recorded_run(run, seed), kind) for run in runs))


def lab_sources(seeds: Sequence[int], kind: CloudKind) -> list[PairSource]:
    """A pair of runs of figure 3.6 for each seed, in turn: from run 5, without objects, to each other run, and back.

    Args:
        seeds: of the surveys.
        kind: of the clouds.

    Returns:
        Sources whose condition is "appeared" or "disappeared".

    Raises:
        InputError: volumetric maps where Open3D is not installed.
    """
    if kind == "volumetric":
        load_open3d("simulating volumetric maps")
    sources = []
    for seed in seeds:
        runs = ONE_TYPE[seed % len(ONE_TYPE)]
        condition = "appeared" if runs[0] == "run5" else "disappeared"
        load = functools.partial(lab_pair, kind, runs, seed)
        sources.append(PairSource(f"{runs[0]} to {runs[1]}, seed {seed}", CLOUD_KINDS[kind], condition, load))
    return sources


def _target(before: Laboratory, after: Laboratory, random: np.random.Generator) -> Float[np.ndarray, "3"]:
    """The middle of a random object that changed."""
    places = [
        run.objects[name][:3, 3]
        for name, kind in object_changes(before, after).items()
        for run, present in ((before, kind != "appeared"), (after, kind != "disappeared"))
        if present
    ]
    return places[int(random.integers(len(places)))]


def _majority(labels: Int[np.ndarray, " n"], group: Int[np.ndarray, " n"], groups: int) -> Int[np.ndarray, " g"]:
    """The most frequent label in each group."""
    numbers = np.unique(labels)
    votes = [np.bincount(group[labels == number], minlength=groups) for number in numbers]
    return numbers[np.argmax(votes, axis=0)]
