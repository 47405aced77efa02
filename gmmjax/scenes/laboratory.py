"""The simulated laboratory: a room of 2 m that a depth camera surveys twice, with truth (after thesis 3.1.3 to 3.1.5).

Granite floor, walls, a docking station, a shelf, handrails and a cupboard, whose places differ from scene to scene;
objects of about 0.3 m come, go, move and stay.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError, check_choice
from gmmjax.pair import Pair, each
from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.families.staging import Arrangement
from gmmjax.scenes.families.things import cuboid
from gmmjax.scenes.gaussians import numpy_generator
from gmmjax.scenes.objects import ROOM_HALF_WIDTH, placed_objects
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at, small_motion
from gmmjax.scenes.surveyed_scene import uncounted

Difficulty = Literal["normal", "hard"]
SurveyKind = Literal["panorama", "frame"]

FRAMES = 16
# The hard level loses this share of the frames of each survey, in one run.
LOST_FRAMES = 0.25
VOXEL = 0.01
# From one pixel that a survey uses to the next, along rows and columns.
PIXEL_STEP = 3.5
MAX_OBJECTS = 5
# A place is occluded when something on its ray is nearer by more than this, metres.
HIDDEN_BY = 0.03


@dataclasses.dataclass(frozen=True, eq=False)
class LaboratoryScene:
    """Two surveys of the laboratory with the truth.

    Attributes:
        before: the first survey [n0, 3], metres.
        after: the second one [n1, 3], misregistered.
        truth_before: per point -1, or the number of the change; a moved object has the same number in both clouds.
        truth_after: the same for `after`.
        unseen_before: per point whether the other survey could not see its place.
        unseen_after: the same for `after`.
        views_before: where the camera stood.
        views_after: where it believed to stand: misregistered like its cloud.
        uncounted_before: changes with fewer than 40 points in `before`, or half of whose points are unseen.
        uncounted_after: the same for `after`.
        kinds: of each change: "appeared", "disappeared" or "moved".
        misregistration: rigid motion [4, 4] of the after cloud and its views.
        motions: for each moved object the rigid motion [4, 4] from `before` to `after` as they are given.
    """

    before: Float[np.ndarray, "n0 3"]
    after: Float[np.ndarray, "n1 3"]
    truth_before: Int[np.ndarray, " n0"]
    truth_after: Int[np.ndarray, " n1"]
    unseen_before: Bool[np.ndarray, " n0"]
    unseen_after: Bool[np.ndarray, " n1"]
    views_before: SensorViews
    views_after: SensorViews
    uncounted_before: frozenset[int]
    uncounted_after: frozenset[int]
    kinds: tuple[str, ...]
    misregistration: Float[np.ndarray, "4 4"]
    motions: dict[int, Float[np.ndarray, "4 4"]]


def laboratory_scene(
    key: PRNGKeyArray,
    *,
    appeared: int = 1,
    disappeared: int = 0,
    moved: int = 0,
    level: Difficulty = "normal",
    survey: SurveyKind = "panorama",
) -> LaboratoryScene:
    """A random laboratory, surveyed before and after something changed.

    Args:
        key: random key; the same key gives the same scene.
        appeared: new objects in the after cloud.
        disappeared: objects of the before cloud that are not in the after cloud.
        moved: objects that stand elsewhere in the after cloud.
        level: "normal" has 6 to 10 mm noise, 1 to 2 cm and up to 0.5 degrees misregistration; "hard" the upper ends,
            and a quarter of the frames of each survey is lost.
        survey: "panorama" fuses 16 frames from around the room in voxels of 1 cm; "frame" is one depth frame from
            nearly the same pose in both.

    Raises:
        InputError: a negative number, more than five changed objects, or an unknown level or survey.
    """
    check_choice("level", level, get_args(Difficulty))
    check_choice("survey", survey, get_args(SurveyKind))
    _check_numbers(appeared, disappeared, moved)
    random = numpy_generator(key)
    room, shelf = _room(random, open_front=survey == "frame")
    changes, staying = placed_objects(random, room, shelf, appeared, disappeared, moved)
    arrangement = Arrangement()
    for thing in (room, *staying):
        arrangement.stays(thing)
    for before, after in changes:
        arrangement.change(before, after)
    hard = level == "hard"
    camera = _camera(0.01 if hard else random.uniform(0.006, 0.01), survey)
    stands = _stands(random, survey)
    lost = _lost_frames(random) if hard and survey == "panorama" else Pair(frozenset[int](), frozenset[int]())
    surveys = each(lambda own, gaps: _survey(random, own, stands, camera, survey, gaps), arrangement.solids, lost)
    shift, degrees = (0.02, 0.5) if hard else (random.uniform(0.01, 0.02), random.uniform(0, 0.5))
    kinds = ("disappeared",) * disappeared + ("appeared",) * appeared + ("moved",) * moved
    moves = {number: (old[0].pose(), to[0].pose()) for number, (old, to) in enumerate(changes) if old and to}
    return _scene(surveys, arrangement.solids, small_motion(random, shift, degrees), kinds, moves)


def _check_numbers(appeared: int, disappeared: int, moved: int) -> None:
    for name, number in (("appeared", appeared), ("disappeared", disappeared), ("moved", moved)):
        if isinstance(number, bool) or not isinstance(number, int | np.integer):
            raise InputError(f"{name}={number!r} must be a whole number of objects")
    if min(appeared, disappeared, moved) < 0 or appeared + disappeared + 2 * moved > MAX_OBJECTS:
        raise InputError(
            f"appeared={appeared}, disappeared={disappeared}, moved={moved}: must not be negative, and there is room "
            f"for {MAX_OBJECTS} places of changed objects (a moved one needs two)"
        )


def _camera(noise: float, survey: SurveyKind) -> DepthCamera:
    camera = DepthCamera(noise=noise)
    if survey == "frame":
        return camera
    columns, rows = (int(pixels / PIXEL_STEP) for pixels in (camera.columns, camera.rows))
    return dataclasses.replace(camera, columns=columns, rows=rows)


def _scene(
    surveys: Pair[Recording],
    solids: Pair[list[Solid]],
    misregistration: np.ndarray,
    kinds: tuple[str, ...],
    moves: Mapping[int, tuple[np.ndarray, np.ndarray]],
) -> LaboratoryScene:
    """The scene of two surveys in true coordinates, and of the poses of what moved before and after."""
    unseen = each(
        lambda own, other, there: ~other.saw(own.points, there, HIDDEN_BY), surveys, surveys.swapped, solids.swapped
    )
    few = each(lambda there, own, hidden: uncounted(there, own.labels, hidden), solids, surveys, unseen)
    return LaboratoryScene(
        before=surveys.before.points,
        after=surveys.after.points @ misregistration[:3, :3].T + misregistration[:3, 3],
        truth_before=surveys.before.labels,
        truth_after=surveys.after.labels,
        unseen_before=unseen.before,
        unseen_after=unseen.after,
        views_before=surveys.before.views,
        views_after=surveys.after.views.moved(misregistration),
        uncounted_before=few.before,
        uncounted_after=few.after,
        kinds=kinds,
        misregistration=misregistration,
        motions={number: misregistration @ to @ np.linalg.inv(old) for number, (old, to) in moves.items()},
    )


def _room(random: np.random.Generator, open_front: bool) -> tuple[list[Solid], Solid]:
    """Floor, walls and what is fixed to them, and which of it is the shelf.

    A single frame looks in from where the front wall would be.
    """
    wall, height = 0.1, random.uniform(1.3, 1.5)
    middle = ROOM_HALF_WIDTH + wall / 2
    solids = [cuboid((0.0, 0.0, -0.05), (2.4, 2.4, 0.1)), cuboid((0.0, middle, height / 2 - 0.1), (2.4, wall, height))]
    solids += [cuboid((side * middle, 0.0, height / 2 - 0.1), (wall, 2.4, height)) for side in (-1.0, 1.0)]
    if not open_front:
        solids.append(cuboid((0.0, -middle, height / 2 - 0.1), (2.4, wall, height)))
    dock, width = random.uniform(-0.5, 0.5), random.uniform(0.32, 0.48)
    solids.append(cuboid((dock, 1.05, 0.5), (width, 0.12, random.uniform(0.3, 0.45))))
    solids.append(cuboid((dock, 0.97, random.uniform(0.42, 0.5)), (0.15, 0.06, 0.15)))
    depth = random.uniform(0.25, 0.4)
    shelf = cuboid(
        (depth / 2 - ROOM_HALF_WIDTH, random.uniform(-0.4, 0.4), random.uniform(0.55, 0.7)),
        (depth, random.uniform(0.6, 0.9), 0.03),
    )
    solids.append(shelf)
    # Handrails: one along the wall and one upright.
    thick = random.uniform(0.02, 0.04)
    solids.append(cuboid((1.06, random.uniform(-0.5, 0.5), random.uniform(0.5, 1.0)), (thick, 0.6, thick)))
    upright = cuboid((1.06, random.uniform(-0.9, 0.9), 0.6), (thick, thick, random.uniform(0.5, 0.9)))
    solids.append(dataclasses.replace(upright, round=True))
    if not open_front:
        deep = random.uniform(0.15, 0.25)
        extent = (random.uniform(0.2, 0.4), deep, random.uniform(0.35, 0.6))
        solids.append(cuboid((random.uniform(-0.8, 0.8), deep / 2 - ROOM_HALF_WIDTH, extent[2] / 2), extent))
    return solids, shelf


def _stands(random: np.random.Generator, survey: SurveyKind) -> list[tuple[np.ndarray, np.ndarray]]:
    """Positions of the camera, and the points that it looks at.

    Of a survey every fourth frame is a panorama's, outward from near the middle, and the others look inward from a
    rectangular path along the walls (thesis 3.1.2).
    """
    if survey == "frame":
        return [(np.array([random.uniform(-0.3, 0.3), -1.8, 1.5]), np.array([random.uniform(-0.1, 0.1), 0.0, 0.1]))]
    stands = []
    start = random.uniform(0, 2 * np.pi)
    for index in range(FRAMES):
        angle = start + 2 * np.pi * index / FRAMES
        round_the_room = np.array([np.cos(angle), np.sin(angle)])
        if index % 4 == 3:
            position = np.array([*(-0.25 * round_the_room), 1.2])
            stands.append((position, np.array([*(0.9 * round_the_room), 0.3])))
            continue
        rectangle = np.array([0.85, 0.75]) * round_the_room / np.abs(round_the_room).max()
        position = np.array([*np.clip(rectangle, -0.7, 0.7), 1.1 + 0.25 * (index % 2)])
        stands.append((position, np.array([*(-0.6 * round_the_room), 0.15 + 0.35 * (index % 3 == 0)])))
    return stands


def _lost_frames(random: np.random.Generator) -> Pair[frozenset[int]]:
    """Draw one run of lost frames for each survey, without a frame in common."""
    lost = int(LOST_FRAMES * FRAMES)
    first = int(random.integers(FRAMES))
    second = first + int(random.integers(lost, FRAMES - lost + 1))
    return Pair(first, second).map(lambda start: frozenset((start + step) % FRAMES for step in range(lost)))


def _survey(
    random: np.random.Generator,
    solids: Sequence[Solid],
    stands: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: DepthCamera,
    survey: SurveyKind,
    lost: frozenset[int],
) -> Recording:
    kept = [index for index in range(len(stands)) if index not in lost]
    near, aim = (0.03, 0.05) if survey == "panorama" else (0.003, 0.003)
    poses = np.stack([looking_at(_about(random, stands[i][0], near), _about(random, stands[i][1], aim)) for i in kept])
    frames = [camera.frame(solids, pose, random) for pose in poses]
    points = [frame for frame, _ in frames]
    if survey == "panorama":
        # Each frame is a little off its believed pose.
        points = [_off(random, frame, pose[:3, 3]) for frame, pose in zip(points, poses, strict=True)]
    views = SensorViews(poses, camera.field_of_view, camera.max_range)
    joined = np.concatenate(points)
    recording = Recording(joined, joined, np.concatenate([labels for _, labels in frames]), views, views)
    return recording.fused(VOXEL) if survey == "panorama" else recording


def _about(random: np.random.Generator, place: np.ndarray, deviation: float) -> np.ndarray:
    return np.asarray(place + deviation * random.standard_normal(3))


def _off(random: np.random.Generator, points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    motion = small_motion(random, 0.003, 0.1)
    return np.asarray((points - centre) @ motion[:3, :3].T + motion[:3, 3] + centre)
