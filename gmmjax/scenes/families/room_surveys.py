"""Surveys of rooms by depth cameras or from tripods, and rooms in which something was moved within its place."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.families import things
from gmmjax.scenes.families.cameras import again, poses_about, triangulating_camera
from gmmjax.scenes.families.interior import furnished_room
from gmmjax.scenes.families.scanners import level_poses, scanned
from gmmjax.scenes.families.staging import Arrangement, Support, displaced
from gmmjax.scenes.families.things import chance, log_uniform, moved
from gmmjax.scenes.laser_scanner import Beam, TripodScanner
from gmmjax.scenes.ray_casting import UNLABELLED, Solid, cast
from gmmjax.scenes.recording import Recording, drawn_density
from gmmjax.scenes.rigid_motions import turned
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

_SHIFTED = things.one_of(
    *(things.box, things.box, things.cart, things.drum, things.machine, things.machine, things.stack)
)
_STAYING = things.one_of(things.bin_, things.box, things.chair, things.machine, things.suitcase)


def surveyed_room(
    random: np.random.Generator, arrangement: Arrangement, size: Float[np.ndarray, "3"], aim: Float[np.ndarray, "3"]
) -> SurveyedScene:
    """The room of this size, as one to three frames of a depth camera or one or two stations of a scanner see it.

    The cameras look at the aim.
    """
    survey = _frames if chance(random, 0.6) else _stations
    recordings, frame, hidden_by = survey(random, arrangement, size, aim)
    if chance(random, 0.3):
        recordings = drawn_density(random, recordings)
    return surveyed_scene(arrangement.solids, recordings, frame, hidden_by=hidden_by)


def _frames(
    random: np.random.Generator, arrangement: Arrangement, size: np.ndarray, aim: np.ndarray
) -> tuple[Pair[Recording], Frame, float]:
    views = int(random.integers(1, 4))
    camera = triangulating_camera(random, random.uniform(14_000, 36_000) / views, random.uniform(3.5, 6.0), edge=0.08)
    poses = _in_sight(arrangement.solids.before, aim, lambda: _camera_poses(random, views, size, aim))
    still = chance(random, 0.4)
    stands = Pair(poses, poses if still else again(random, poses, 0.06, 2.0))
    recordings = each(lambda solids, own: camera.recording(solids, own, random), arrangement.solids, stands)
    frame = Frame.drawn(random, shift=0.003 if still else 0.02, degrees=0.2 if still else 1.0)
    # The noise at 3 m.
    return recordings, frame, 0.03 + 2 * 9 * camera.noise


def _camera_poses(
    random: np.random.Generator, views: int, size: np.ndarray, aim: np.ndarray
) -> Float[np.ndarray, "v 4 4"]:
    """Side by side within the room, on the side of its middle."""
    inward = np.array([0.0, -0.2 * size[1]]) - aim[:2]
    azimuth = float(np.arctan2(inward[1], inward[0])) + random.uniform(-0.6, 0.6)
    apart = random.uniform(0.15, 0.4) * (np.arange(views) - (views - 1) / 2)
    distance = random.uniform(1.3, max(1.5, min(3.2, 0.7 * size[1])))
    poses = poses_about(random, aim, azimuth, distance, random.uniform(0.1, 0.8), apart)
    margin = np.array([*(size[:2] / 2 - 0.2), size[2] - 0.2])
    poses[:, :3, 3] = np.clip(poses[:, :3, 3], [-margin[0], -margin[1], 0.3], margin)
    return poses


def _in_sight(
    solids: Sequence[Solid], aim: np.ndarray, draw: Callable[[], Float[np.ndarray, "v 4 4"]]
) -> Float[np.ndarray, "v 4 4"]:
    """Poses from the first of which nothing that stays hides what is looked at, where such are found."""
    standing = [solid for solid in solids if solid.label == UNLABELLED]
    poses = draw()
    for _ in range(10):
        position = poses[0, :3, 3]
        distance = float(np.linalg.norm(aim - position))
        first_hit, _ = cast(standing, position, (aim - position)[None] / distance)
        if first_hit[0] > distance - 0.6 and not any(solid.contains(position[None], 0.1)[0] for solid in standing):
            break
        poses = draw()
    return poses


def _stations(
    random: np.random.Generator, arrangement: Arrangement, size: np.ndarray, aim: np.ndarray
) -> tuple[Pair[Recording], Frame, float]:
    noise = log_uniform(random, 0.001, 0.006)
    mixed, lost = random.uniform(0.0, 0.3), random.uniform(0.0, 0.05)
    stations = int(random.integers(1, 3))
    scanner = TripodScanner(
        Beam(noise=noise, max_range=30.0, mixed=mixed, lost=lost),
        rays=int(random.uniform(22_000, 39_000) / stations),
        horizontal=360.0 if chance(random, 0.5) else random.uniform(190.0, 270.0),
        lowest=random.uniform(-65, -45),
        highest=random.uniform(30, 90),
    )
    height = random.uniform(1.1, 1.7)

    def stands() -> Float[np.ndarray, "v 4 4"]:
        places = random.uniform(-0.3, 0.3, (stations, 2)) * size[:2] + np.array([0.0, -0.1 * size[1]])
        return level_poses(random, places, height, aim)

    first = _in_sight(arrangement.solids.before, aim, stands)
    second = first.copy()
    if chance(random, 0.7):
        second[:, :2, 3] += random.uniform(-0.4, 0.4, (stations, 2))
    recordings = scanned(random, scanner, arrangement.solids, Pair(first, second))
    return recordings, Frame.drawn(random, shift=0.01, degrees=0.2), 0.03


def small_motions(random: np.random.Generator) -> SurveyedScene:
    """Furnished rooms: a chair is turned by 5 to 60 degrees, or a box or a machine shifted by 2 to 15 cm.

    Now and then two things; nothing in a third of the scenes.
    """
    size = random.uniform([3.0, 3.0, 2.3], [6.0, 6.0, 3.0])
    room = furnished_room(random, size)
    arrangement = Arrangement()
    arrangement.stays(room.solids)
    aim = np.array([0.0, 0.15 * size[1], 0.4])
    for _ in range(0 if chance(random, 1 / 3) else 1 + chance(random, 0.3)):
        place = _move(random, arrangement, room.floor)
        aim = aim if place is None else np.array([place[0], place[1], 0.4])
    arrangement.furnish(random, [room.floor], _STAYING, int(random.integers(1, 5)))
    return surveyed_room(random, arrangement, size, aim)


def _move(random: np.random.Generator, arrangement: Arrangement, floor: Support) -> Float[np.ndarray, "3"] | None:
    """Moves a thing a little, and tells where it stands; None where there is no place for it."""
    turns = chance(random, 0.4)
    thing = things.chair(random) if turns else _SHIFTED(random)
    pose = floor.pose(random, thing, 0.1)
    if pose is None:
        return None
    if turns:
        angle = np.radians(random.uniform(5, 60)) * random.choice([-1, 1])
        shift = random.uniform(-0.05, 0.05, 2) if chance(random, 0.5) else np.zeros(2)
        motion = pose @ turned(float(angle), (*shift, 0.0)) @ np.linalg.inv(pose)
    else:
        motion = displaced(random, pose, (0.02, 0.15), np.radians(5) if chance(random, 1 / 3) else 0.0)
    arrangement.moves(moved(thing, pose), np.asarray(motion))
    return np.asarray(pose[:3, 3])
