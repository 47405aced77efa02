"""Two surveys of the laboratory as a pair of clouds, with the true change of every point."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.clouds import SensorViews
from gmmjax.errors import check_choice
from gmmjax.scenes import UNLABELLED, DepthCamera, Solid, looking_at, uncounted
from gmmjax.thesis.laboratory.clouds import CLOUD_KINDS, CloudKind, LabCloud, lab_cloud
from gmmjax.thesis.laboratory.recording import NOISE, START, Pattern, frame_from, recorded_run
from gmmjax.thesis.laboratory.room import THINGS
from gmmjax.thesis.laboratory.runs import RUNS, Laboratory, RunName, laboratory_of, object_changes

# Single frames: horizontal distance of the camera from the object and its height, metres.
DISTANCE, EYE_HEIGHT = 1.3, 0.8
# Standard deviation between the two camera poses of a pair of single frames, metres.
POSE_DIFFERENCE = 0.01
# The camera stays within this distance of the room's middle on both horizontal axes, metres.
CAMERA_REACH = 0.75


@dataclasses.dataclass(frozen=True, eq=False)
class LabPair:
    """Two clouds with the truth.

    Attributes:
        before: the cloud of the first run.
        after: the cloud of the second run.
        changes: "appeared", "disappeared" or "moved", by the name of each object that changed.
        truth_before: per point -1, or the label of the object that changed; a moved object has the same in both clouds.
        truth_after: the same for `after`.
        unseen_before: per point whether the other survey did not observe its place.
        unseen_after: the same for `after`.
        uncounted_before: labels of changed objects of which `before` has almost no points that the other survey could
            observe.
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
        pattern: of the surveys' paths; not used for single frames.

    Raises:
        InputError: an unknown kind, run or pattern; or volumetric maps without Open3D.
    """
    check_choice("kind", kind, tuple(CLOUD_KINDS))
    if kind == "frame":
        return lab_frames(runs, seed)
    repeated = int(runs[0] == runs[1])
    recordings = (
        recorded_run(run, seed, occasion=occasion, pattern=pattern)
        for run, occasion in zip(runs, (0, repeated), strict=True)
    )
    return with_truth(*(lab_cloud(recording, kind) for recording in recordings))


def lab_frames(runs: tuple[RunName, RunName], seed: int) -> LabPair:
    """Single frames of an object that changed between two runs; `lab_pair` of kind "frame"."""
    random = np.random.default_rng([seed, *(RUNS.index(run) for run in runs)])
    return _frame_pair(laboratory_of(runs[0], seed), laboratory_of(runs[1], seed), random)


def with_truth(before: LabCloud, after: LabCloud) -> LabPair:
    """Two clouds of one kind, with the objects that changed between their laboratories."""
    kinds = object_changes(before.laboratory, after.laboratory)
    changed = [THINGS.index(name) for name in kinds]
    truth_before, truth_after = (
        np.where(np.isin(cloud.things, changed), cloud.things, UNLABELLED) for cloud in (before, after)
    )
    unseen_before, unseen_after = ~after.could_see(before), ~before.could_see(after)
    few_before = uncounted(_changed_solids(before.laboratory, changed), truth_before, unseen_before)
    few_after = uncounted(_changed_solids(after.laboratory, changed), truth_after, unseen_after)
    return LabPair(before, after, kinds, truth_before, truth_after, unseen_before, unseen_after, few_before, few_after)


def _frame_pair(before: Laboratory, after: Laboratory, random: np.random.Generator) -> LabPair:
    """Two frames of a change from almost the same pose, each in its camera's coordinates."""
    camera = DepthCamera(noise=random.uniform(*NOISE))
    target = _target(before, after, random)
    # From the middle of the room towards the wall.
    inward = -target[:2] / max(float(np.linalg.norm(target[:2])), 1e-9)
    place = np.clip(target[:2] + DISTANCE * inward, -CAMERA_REACH, CAMERA_REACH) + 0.1 * random.standard_normal(2)
    clouds = []
    for surveyed in (before, after):
        position = np.array([*place, EYE_HEIGHT]) + POSE_DIFFERENCE / np.sqrt(3) * random.standard_normal(3)
        aim = target + POSE_DIFFERENCE * random.standard_normal(3)
        pose = looking_at(position, aim)
        frame, things = frame_from(surveyed, camera, pose, random, START)
        views = SensorViews(np.eye(4)[None], camera.field_of_view, camera.max_range)
        clouds.append(LabCloud(frame.cloud.points, things, views, pose, surveyed, frame))
    return with_truth(*clouds)


def _target(before: Laboratory, after: Laboratory, random: np.random.Generator) -> Float[np.ndarray, "3"]:
    """The middle of a random object that changed; without changes a point at the back wall."""
    places = [
        run.objects[name][:3, 3]
        for name, kind in object_changes(before, after).items()
        for run, present in ((before, kind != "appeared"), (after, kind != "disappeared"))
        if present
    ]
    return places[int(random.integers(len(places)))] if places else np.array([0.0, 0.9, 0.4])


def _changed_solids(laboratory: Laboratory, changed: list[int]) -> list[Solid]:
    return [solid for solid in laboratory.solids if solid.label in changed]
