"""Furnished rooms that a depth camera surveys, and kitchens in which small things stand on counters and tables."""

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair
from gmmjax.scenes.families import things
from gmmjax.scenes.families.cameras import (
    again,
    free_position,
    kept_frames,
    panorama_poses,
    recorded,
    time_of_flight_camera,
)
from gmmjax.scenes.families.interior import Interior, furnished_room
from gmmjax.scenes.families.staging import Support, Turnover, staged
from gmmjax.scenes.families.things import chance
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording, drawn_density
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

_ROOM_THINGS = things.one_of(
    *(things.box, things.box, things.stack, things.drum, things.bag, things.bag, things.bin_, things.ball),
    *(things.suitcase, things.chair, things.lamp, things.plant, things.screen, things.clutter, things.clutter),
    things.vessel,
)
_KITCHEN_THINGS = things.one_of(*[things.vessel] * 3, *[things.bottle] * 2, things.box, things.clutter)


def rooms(random: np.random.Generator) -> SurveyedScene:
    """Rooms of 3 to 6 m in which things of 0.1 to 0.8 m come, go and move: panoramas, lost frames, single frames."""
    room = furnished_room(random, random.uniform([3.0, 2.5, 2.2], [6.0, 5.0, 3.0]))
    solids = staged(random, room.solids, [room.floor, room.floor, *room.tops], _ROOM_THINGS, int(random.integers(2, 7)))
    if chance(random, 0.3):
        recordings = _single_frames(random, room, solids)
    else:
        recordings = drawn_density(random, _panoramas(random, room, solids))
    return surveyed_scene(solids, recordings, Frame.drawn(random, shift=0.04, degrees=0.6), hidden_by=0.04)


def kitchens(random: np.random.Generator) -> SurveyedScene:
    """Rooms in which small things come, go and move on counters and tables, seen from one side or from another."""
    room = furnished_room(random, random.uniform([2.5, 2.5, 2.3], [5.0, 4.0, 2.8]))
    places = room.tops or [room.floor]
    solids = staged(random, room.solids, places, _KITCHEN_THINGS, int(random.integers(2, 8)), Turnover(moved=1))
    camera = time_of_flight_camera(random, columns=90, max_range=3.5)
    first = _poses_about(random, room, places, solids.before)
    near = chance(random, 0.6)
    second = again(random, first, 0.3, 8.0) if near else _poses_about(random, room, places, solids.after)
    recordings = recorded(random, solids, Pair(first, second), camera)
    frame = Frame.drawn(random, shift=0.03, degrees=0.5)
    recordings = drawn_density(random, recordings, most=(20_000, 40_000), least=12_000)
    return surveyed_scene(solids, recordings, frame, hidden_by=0.025)


def _panoramas(random: np.random.Generator, room: Interior, solids: Pair[list[Solid]]) -> Pair[Recording]:
    frames = int(random.integers(14, 26))
    camera = time_of_flight_camera(random, columns=72, max_range=5.5)
    first = panorama_poses(random, room.size, solids.before, frames)
    if chance(random, 0.6):
        second = again(random, first, random.uniform(0.05, 0.4), 8.0)
    else:
        second = panorama_poses(random, room.size, solids.after, frames)
    lost = random.choice([0.0, random.uniform(0.1, 0.45)])
    return recorded(random, solids, kept_frames(random, Pair(first, second), lost), camera)


def _single_frames(random: np.random.Generator, room: Interior, solids: Pair[list[Solid]]) -> Pair[Recording]:
    """One frame of either survey, from nearly the same pose."""
    camera = time_of_flight_camera(random, columns=180, max_range=6.0)
    angle = random.uniform(0, 2 * np.pi)
    behind = -0.4 * room.size[:2] * [np.cos(angle), np.sin(angle)]
    position = free_position(random, solids.before, behind, np.full(2, 0.1), (1.0, 2.0))
    pose = looking_at(position, np.array([*(-0.3 * behind), random.uniform(0.0, 0.6)]))[None]
    return recorded(random, solids, Pair(pose, again(random, pose, 0.15, 4.0)), camera)


def _poses_about(
    random: np.random.Generator, room: Interior, tops: list[Support], solids: list[Solid]
) -> Float[np.ndarray, "v 4 4"]:
    """Poses from one side of the room that look at what its furniture carries."""
    side, inner = random.uniform(0, 2 * np.pi), room.size[:2] / 2 - 0.3
    poses = []
    for index in range(int(random.integers(6, 14))):
        top = tops[index % len(tops)].middle[:3, 3]
        angle = side + random.normal(0, 0.6)
        stand = top[:2] + random.uniform(0.8, 1.8) * np.array([np.cos(angle), np.sin(angle)])
        heights = (top[2] + 0.3, top[2] + 0.9)
        position = free_position(random, solids, np.clip(stand, -inner, inner), np.full(2, 0.15), heights)
        poses.append(looking_at(position, top + random.normal(0, 0.2, 3)))
    return np.stack(poses)
