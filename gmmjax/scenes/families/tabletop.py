"""A depth camera before a table or a floor with small, mostly curved things."""

import numpy as np
from jaxtyping import Bool, Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.families.arrangements import (
    Arrangement,
    FreePlaces,
    Thing,
    box,
    chance,
    height,
    moved,
    reach,
    standing_on,
)
from gmmjax.scenes.families.depth_frames import checkerboard, drawn_camera, poses_about, put_up_again, surveyed_by
from gmmjax.scenes.families.tableware import tableware
from gmmjax.scenes.ray_casting import UNLABELLED, Solid
from gmmjax.scenes.recording import Recording, joined
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene
from gmmjax.scenes.triangulating_camera import TriangulatingCamera


def tabletop_scene(random: np.random.Generator) -> SurveyedScene:
    """A table that a depth camera, or two or three, looks at from 0.6 to 1.5 m.

    Things come, go, are exchanged in their place, moved a little or far; nothing changes in a third of the scenes. The
    errors of the frames differ slowly over them. A part of the scenes is one frame whose pixels are split between the
    two clouds, as test pairs are made of single frames.

    Args:
        random: of everything.
    """
    half = random.uniform([0.3, 0.25], [0.6, 0.4])
    arrangement = Arrangement()
    arrangement.stays(_furniture(random, half))
    places = FreePlaces(half, gap=0.01)
    _change(random, arrangement, places)
    for _ in range(int(random.integers(1, 8))):
        _stand(random, arrangement, places)
    split = chance(random, 0.25)
    views = 1 if split else int(random.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))
    pixels = random.uniform(12_000, 36_000) * (2 if split else 1) / views
    camera = drawn_camera(random, pixels, max_range=random.uniform(2.0, 5.0), edge=0.05)
    # Of the noise at the far end of the table; of what lies beyond it, less is called hidden than is.
    hidden_by = 0.012 + 6 * camera.noise + 2 * camera.distortion
    poses = _poses(random, views, half)
    if split:
        recordings = _halves(random, camera, arrangement, poses[0])
        unmoved = Frame.drawn(random, shift=0.0, degrees=0.0)
        return surveyed_scene(arrangement.solids, recordings, unmoved, hidden_by=hidden_by)
    still = chance(random, 0.5)
    stands = Pair(poses, poses if still else put_up_again(random, poses, 0.01))
    recordings = each(lambda solids, own: surveyed_by(random, camera, solids, own), arrangement.solids, stands)
    frame = Frame.drawn(random, shift=0.003 if still else 0.015, degrees=0.2 if still else 1.0)
    return surveyed_scene(arrangement.solids, recordings, frame, hidden_by=hidden_by)


def _poses(random: np.random.Generator, views: int, half: np.ndarray) -> list[np.ndarray]:
    """Side by side in front of the table, 0.6 to 1.5 m from its middle."""
    aim = np.array([*(random.uniform(-0.2, 0.2, 2) * half), random.uniform(0.0, 0.1)])
    azimuth, elevation = -np.pi / 2 + random.uniform(-0.4, 0.4), random.uniform(np.radians(15), np.radians(60))
    apart = random.uniform(0.3, 0.8) * np.arange(views)
    return poses_about(random, aim, azimuth, random.uniform(0.6, 1.5), elevation, list(apart))


def _furniture(random: np.random.Generator, half: np.ndarray) -> list[Solid]:
    """A table top with or without the floor below, or the floor; a wall behind or none."""
    on_floor = chance(random, 0.3)
    size = 2 * half + (random.uniform(1.0, 2.0, 2) if on_floor else random.uniform(0.05, 0.5, 2))
    solids = [box((0.0, 0.0, -0.02), (*size, 0.04))]
    if not on_floor and chance(random, 0.6):
        solids.append(box((0.0, 0.0, -random.uniform(0.5, 0.8)), (6.0, 6.0, 0.04)))
    if chance(random, 0.5):
        solids.append(box((0.0, half[1] + random.uniform(0.1, 0.8), 0.3), (4.0, 0.04, 3.0), random.uniform(-0.4, 0.4)))
    if not on_floor and chance(random, 0.2):
        edge = half[1] + random.uniform(-0.02, 0.02)
        solids.append(box((0.0, edge, 0.15), (2 * half[0], 0.02, 0.3)))
    return solids


def _change(random: np.random.Generator, arrangement: Arrangement, places: FreePlaces) -> None:
    """One to three changes, none in a third of the scenes."""
    if chance(random, 1 / 3):
        return
    for _ in range(int(random.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))):
        kind = str(random.choice(["comes", "goes", "exchanged", "nudged", "moved"]))
        thing = tableware(random)
        # Room for what comes in its place, and for a nudge.
        room = {"exchanged": 0.03, "nudged": 0.08}.get(kind, 0.0)
        place = _on_table(random, thing, places, room)
        if place is None:
            return
        standing = moved(thing, place)
        if kind == "comes":
            arrangement.comes(standing)
        elif kind == "goes":
            arrangement.goes(standing)
        elif kind == "exchanged":
            arrangement.goes(standing)
            arrangement.comes(moved(_another(random, thing), place))
        elif kind == "nudged":
            arrangement.moves(standing, _nudge(random, place))
        elif (target := _on_table(random, thing, places)) is not None:
            arrangement.moves(standing, target @ np.linalg.inv(place))


def _on_table(
    random: np.random.Generator, thing: Thing, places: FreePlaces, room: float = 0.0
) -> Float[np.ndarray, "4 4"] | None:
    """The motion from the origin to a place of the table with free room about it; None where there is none."""
    place = places.take(random, reach(thing) + room)
    return None if place is None else standing_on((*place, 0.0), random.uniform(0, 2 * np.pi))


def _another(random: np.random.Generator, thing: Thing) -> Thing:
    """A thing that stands in the place of the other, and differs from it by 2 cm in height or in width."""
    for _ in range(100):
        other = tableware(random)
        narrower = reach(other) < reach(thing) + 0.03
        if narrower and max(abs(height(other) - height(thing)), abs(reach(other) - reach(thing))) > 0.02:
            return other
    return (box((0.0, 0.0, height(thing) / 2 + 0.02), (0.06, 0.06, height(thing) + 0.04)),)


def _nudge(random: np.random.Generator, place: np.ndarray) -> Float[np.ndarray, "4 4"]:
    """A shift by 1.5 to 8 cm, of one in two with a rotation."""
    direction, length = random.uniform(0, 2 * np.pi), random.uniform(0.015, 0.08)
    yaw = random.uniform(-1.0, 1.0) if chance(random, 0.5) else 0.0
    there = place.copy()
    there[:2, 3] += length * np.array([np.cos(direction), np.sin(direction)])
    return np.asarray(there @ standing_on((0.0, 0.0, 0.0), yaw) @ np.linalg.inv(place))


def _stand(random: np.random.Generator, arrangement: Arrangement, places: FreePlaces) -> None:
    """A thing that stays, now and then with another on it, which may be what comes, goes or is exchanged."""
    thing = tableware(random)
    place = _on_table(random, thing, places)
    if place is None:
        return
    arrangement.stays(moved(thing, place))
    flat = len(thing) == 1 and type(thing[0]) is Solid and min(thing[0].extent[:2]) > 0.08
    if not flat or chance(random, 0.4):
        return
    lifted = place @ standing_on((0.0, 0.0, height(thing)), random.uniform(0, 2 * np.pi))
    upper = tableware(random)
    if reach(upper) > min(thing[0].extent[:2]) * 0.75:
        return
    if arrangement.changes and chance(random, 0.5):
        (arrangement.comes if chance(random, 0.5) else arrangement.goes)(moved(upper, lifted))
    else:
        arrangement.stays(moved(upper, lifted))


def _halves(
    random: np.random.Generator, camera: TriangulatingCamera, arrangement: Arrangement, pose: np.ndarray
) -> Pair[Recording]:
    """One frame, its even pixels before and its odd ones after; what is not there at one time is cut out of it.

    Where both times show different things the frame shows all of them, and nothing lies where one of them hides it.
    """
    cut_out = chance(random, 0.6)
    everything = [*arrangement.solids.before, *(solid for solid in arrangement.solids.after if solid.label >= 0)]
    distortion = camera.distortion_of(random)
    even = checkerboard(camera.camera)

    def half(solids: list[Solid], pixels: Bool[np.ndarray, " n"]) -> Recording:
        points, labels = camera.frame(everything if cut_out else solids, pose, distortion, random, pixels)
        there = np.isin(labels, [UNLABELLED, *(solid.label for solid in solids)])
        stand, ideal = pose[None], camera.camera
        return joined([(points[there], labels[there])], stand, stand, ideal.field_of_view, ideal.max_range)

    return each(half, arrangement.solids, Pair(even, ~even))
