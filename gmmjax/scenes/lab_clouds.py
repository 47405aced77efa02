"""Two surveys of the laboratory as two clouds of each kind of the thesis's data, with the truth of every point."""

import dataclasses
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.clouds import SensorViews, voxel_grid
from gmmjax.errors import check_choice
from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.granite_lab import RUNS, THINGS, Laboratory, RunName, changes, laboratory
from gmmjax.scenes.ray_casting import UNLABELLED, Solid
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.robot_survey import START, Pattern, Recording, frame_from, recorded_run
from gmmjax.scenes.visibility import seen, uncounted
from gmmjax.surveys import Frame, localised_map, volumetric_map

CloudKind = Literal["frame", "volumetric", "localised"]
KINDS: tuple[CloudKind, ...] = get_args(CloudKind)
# The voxel filter's edge (thesis 3.1.6), and that of the volumetric maps, metres.
VOXEL = 0.01
# Nearest measured points of a vertex of a volumetric map; it is on what most of them are on.
VOTES = 5
# Single frames: how far from the object and how high the camera stands, metres, and how far two frames of one place are
# apart.
DISTANCE, EYE, APART = 1.3, 0.8, 0.01
# The camera stays in the room.
REACH = 0.75


@dataclasses.dataclass(frozen=True, eq=False)
class LabCloud:
    """A cloud of the laboratory.

    Attributes:
        points: metres, in the coordinates of the survey.
        things: per point the label of what it is on (an index in `THINGS`); -1 where that is nothing.
        views: where the camera believed to stand.
        to_scene: rigid motion from the survey's coordinates to the true ones.
        laboratory: what was surveyed.
        frame: of a single frame, with its pixels.
    """

    points: Float64[np.ndarray, "n 3"]
    things: Int[np.ndarray, " n"]
    views: SensorViews
    to_scene: Float64[np.ndarray, "4 4"]
    laboratory: Laboratory
    frame: Frame | None = None

    def could_see(self, other: "LabCloud") -> Bool[np.ndarray, " m"]:
        """Which points of another cloud lie where this survey could see what is there."""
        places = other.points @ other.to_scene[:3, :3].T + other.to_scene[:3, 3]
        return seen(places, self.laboratory.solids, self.views.moved(self.to_scene))


@dataclasses.dataclass(frozen=True, eq=False)
class LabPair:
    """Two clouds with the truth.

    Attributes:
        before: the cloud of the first run.
        after: the cloud of the second run.
        changes: what happened, by the name of the object: "appeared", "disappeared" or "moved".
        truth_before: per point -1, or the label of the object that changed; a moved object has the same in both clouds.
        truth_after: the same for `after`.
        unseen_before: per point whether the other survey could not see its place.
        unseen_after: the same for `after`.
        uncounted_before: labels of changed objects that `before` has nearly nothing of that the other could see.
        uncounted_after: the same for `after`.
    """

    before: LabCloud
    after: LabCloud
    changes: dict[str, str]
    truth_before: Int[np.ndarray, " n0"]
    truth_after: Int[np.ndarray, " n1"]
    unseen_before: Bool[np.ndarray, " n0"]
    unseen_after: Bool[np.ndarray, " n1"]
    uncounted_before: frozenset[int]
    uncounted_after: frozenset[int]


def lab_pair(kind: CloudKind, runs: tuple[RunName, RunName], seed: int, *, pattern: Pattern = "geometric") -> LabPair:
    """Two runs of the laboratory as clouds of one kind.

    Args:
        kind: of the clouds.
        runs: the one before and the one after; the same run twice is surveyed twice.
        seed: of the places of the objects, the paths and the noise.
        pattern: of the surveys; single frames have none.

    Raises:
        InputError: an unknown kind, run or pattern; or volumetric maps without Open3D.
    """
    check_choice("kind", kind, KINDS)
    if kind == "frame":
        return lab_frames(runs, seed)
    again = int(runs[0] == runs[1])
    recordings = (
        recorded_run(run, seed, occasion=occasion, pattern=pattern)
        for run, occasion in zip(runs, (0, again), strict=True)
    )
    return compared(*(lab_cloud(recording, kind) for recording in recordings))


def lab_frames(runs: tuple[RunName, RunName], seed: int) -> LabPair:
    """Single frames of something that changed between two runs; `lab_pair` of kind "frame"."""
    random = np.random.default_rng([seed, *(RUNS.index(run) for run in runs)])
    return frame_pair(laboratory(runs[0], seed), laboratory(runs[1], seed), random)


def lab_cloud(recording: Recording, kind: Literal["volumetric", "localised"]) -> LabCloud:
    """A survey as one cloud.

    Args:
        recording: of the survey.
        kind: "localised": the points of all frames by the robot's localisation, one for each voxel of 1 cm (thesis
            3.1.5); "volumetric": the vertices of the surface that all frames agree on (3.1.4), which needs Open3D.

    Raises:
        InputError: an unknown kind, or Open3D is not there.
    """
    check_choice("kind", kind, ("volumetric", "localised"))
    return _volumetric(recording) if kind == "volumetric" else _localised(recording)


def frame_pair(before: Laboratory, after: Laboratory, random: np.random.Generator) -> LabPair:
    """Single frames of a place where something changed, from nearly the same pose, each in its camera's coordinates.

    Args:
        before: the laboratory of the first run.
        after: the laboratory of the second run.
        random: which change is looked at, how the camera stands, and all noise.
    """
    camera = DepthCamera(noise=random.uniform(0.006, 0.01))
    target = _looked_at(before, after, random)
    # From the side of the room's middle.
    inward = -target[:2] / max(float(np.linalg.norm(target[:2])), 1e-9)
    place = np.clip(target[:2] + DISTANCE * inward, -REACH, REACH) + 0.1 * random.standard_normal(2)
    clouds = []
    for surveyed in (before, after):
        position = np.array([*place, EYE]) + APART / np.sqrt(3) * random.standard_normal(3)
        aim = target + APART * random.standard_normal(3)
        pose = looking_at(position, aim)
        frame, things = frame_from(surveyed, camera, pose, random, START)
        views = SensorViews(np.eye(4)[None], camera.field_of_view, camera.max_range)
        clouds.append(LabCloud(frame.cloud.points, things, views, pose, surveyed, frame))
    return compared(*clouds)


def compared(before: LabCloud, after: LabCloud) -> LabPair:
    """Two clouds of one kind, with what changed from one to the other."""
    kinds = changes(before.laboratory, after.laboratory)
    changed = [THINGS.index(name) for name in kinds]
    truth_before, truth_after = (
        np.where(np.isin(cloud.things, changed), cloud.things, UNLABELLED) for cloud in (before, after)
    )
    unseen_before, unseen_after = ~after.could_see(before), ~before.could_see(after)
    few_before = uncounted(_changed_solids(before.laboratory, changed), truth_before, unseen_before)
    few_after = uncounted(_changed_solids(after.laboratory, changed), truth_after, unseen_after)
    return LabPair(before, after, kinds, truth_before, truth_after, unseen_before, unseen_after, few_before, few_after)


def _changed_solids(laboratory: Laboratory, changed: list[int]) -> list[Solid]:
    return [solid for solid in laboratory.solids if solid.label in changed]


def _looked_at(before: Laboratory, after: Laboratory, random: np.random.Generator) -> np.ndarray:
    """The middle of something that changed; of the room's back wall where nothing did."""
    places = [
        run.objects[name][:3, 3]
        for name, kind in changes(before, after).items()
        for run, there in ((before, kind != "appeared"), (after, kind != "disappeared"))
        if there
    ]
    return places[int(random.integers(len(places)))] if places else np.array([0.0, 0.9, 0.4])


def _localised(recording: Recording) -> LabCloud:
    laid = localised_map(recording.frames, recording.localised.of_sensor(recording.sensor_on_body))
    grid = voxel_grid(laid.points, VOXEL)
    things = np.concatenate(recording.things)
    return LabCloud(
        grid.points,
        _votes(things, grid.voxel_of_point, len(grid.mass)),
        _views(recording, laid.poses),
        np.linalg.inv(recording.misregistration),
        recording.laboratory,
    )


def _volumetric(recording: Recording) -> LabCloud:
    trajectory = recording.adjusted.of_sensor(recording.sensor_on_body)
    surface = volumetric_map(recording.frames, trajectory, voxel_size=VOXEL)
    measured = localised_map(recording.frames, trajectory)
    neighbours = cKDTree(measured.points).query(surface.points, VOTES)[1]
    voters = np.repeat(np.arange(len(surface.points)), VOTES)
    things = np.concatenate(recording.things)[neighbours.ravel()]
    return LabCloud(
        surface.points,
        _votes(things, voters, len(surface.points)),
        _views(recording, measured.poses),
        np.linalg.inv(recording.misregistration),
        recording.laboratory,
    )


def _views(recording: Recording, poses: np.ndarray) -> SensorViews:
    return SensorViews(poses, recording.camera.field_of_view, recording.camera.max_range)


def _votes(labels: np.ndarray, place: np.ndarray, places: int) -> np.ndarray:
    """For each place the label that most of its points have."""
    numbers = np.unique(labels)
    votes = [np.bincount(place[labels == number], minlength=places) for number in numbers]
    return numbers[np.argmax(votes, axis=0)]
