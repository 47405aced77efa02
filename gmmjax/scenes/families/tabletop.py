"""A depth camera before a table or a floor with small, mostly curved things."""

import numpy as np
from jaxtyping import Bool, Float

from gmmjax.pair import Pair, each
from gmmjax.scenes.depth_camera import TriangulatingCamera
from gmmjax.scenes.families.cameras import again, poses_about, triangulating_camera
from gmmjax.scenes.families.staging import Arrangement, Support, displaced, top_of
from gmmjax.scenes.families.tableware import ball, book, bottle, bowl, can, carton, cup, tin
from gmmjax.scenes.families.things import chance, cuboid, footprint, height, moved, one_of
from gmmjax.scenes.ray_casting import UNLABELLED, Solid, StandingObject
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

_TABLEWARE = one_of(ball, book, bottle, bowl, can, carton, cup, tin)


def tabletop(random: np.random.Generator) -> SurveyedScene:
    """A table that a depth camera, or two or three, looks at from 0.6 to 1.5 m.

    Things come, go, are exchanged in their place, moved a little or far; nothing changes in a third of the scenes. The
    errors of the frames differ slowly over them. A part of the scenes is one frame whose pixels are split between the
    two clouds, as test pairs are made of single frames.
    """
    half = random.uniform([0.3, 0.25], [0.6, 0.4])
    arrangement = Arrangement()
    arrangement.stays(_furniture(random, half))
    top = Support(np.eye(4), (2 * half[0], 2 * half[1]), gap=0.01)
    if not chance(random, 1 / 3):
        for _ in range(int(random.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))):
            _change(random, arrangement, top)
    for _ in range(int(random.integers(1, 8))):
        _stand(random, arrangement, top)
    split = chance(random, 0.25)
    views = 1 if split else int(random.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))
    pixels = random.uniform(16_000, 38_000) * (2 if split else 1) / views
    camera = triangulating_camera(random, pixels, max_range=random.uniform(2.0, 5.0), edge=0.05)
    # Of the noise at the far end of the table; of what lies beyond it, less is called hidden than is.
    hidden_by = 0.012 + 6 * camera.noise + 2 * camera.distortion
    poses = _poses(random, views, half)
    if split:
        recordings = _halves(random, camera, arrangement, poses)
        unmoved = Frame.drawn(random, shift=0.0, degrees=0.0)
        return surveyed_scene(arrangement.solids, recordings, unmoved, hidden_by=hidden_by)
    still = chance(random, 0.5)
    stands = Pair(poses, poses if still else again(random, poses, 0.02, 1.0))
    recordings = each(lambda solids, own: camera.recording(solids, own, random), arrangement.solids, stands)
    frame = Frame.drawn(random, shift=0.003 if still else 0.015, degrees=0.2 if still else 1.0)
    return surveyed_scene(arrangement.solids, recordings, frame, hidden_by=hidden_by)


def _poses(random: np.random.Generator, views: int, half: np.ndarray) -> Float[np.ndarray, "v 4 4"]:
    """Side by side in front of the table, 0.6 to 1.5 m from its middle."""
    aim = np.array([*(random.uniform(-0.2, 0.2, 2) * half), random.uniform(0.0, 0.1)])
    azimuth, elevation = -np.pi / 2 + random.uniform(-0.4, 0.4), random.uniform(np.radians(15), np.radians(60))
    apart = random.uniform(0.3, 0.8) * np.arange(views)
    return poses_about(random, aim, azimuth, random.uniform(0.6, 1.5), elevation, apart)


def _furniture(random: np.random.Generator, half: np.ndarray) -> list[Solid]:
    """A table top with or without the floor below, or the floor; a wall behind or none."""
    on_floor = chance(random, 0.3)
    size = 2 * half + (random.uniform(1.0, 2.0, 2) if on_floor else random.uniform(0.05, 0.5, 2))
    solids = [cuboid((0.0, 0.0, -0.02), (*size, 0.04))]
    if not on_floor and chance(random, 0.8):
        solids.append(cuboid((0.0, 0.0, -random.uniform(0.5, 0.8)), (6.0, 6.0, 0.04)))
    if chance(random, 0.5):
        solids.append(
            cuboid((0.0, half[1] + random.uniform(0.1, 0.8), 0.3), (4.0, 0.04, 3.0), random.uniform(-0.4, 0.4))
        )
    if not on_floor and chance(random, 0.2):
        edge = half[1] + random.uniform(-0.02, 0.02)
        solids.append(cuboid((0.0, edge, 0.15), (2 * half[0], 0.02, 0.3)))
    return solids


def _change(random: np.random.Generator, arrangement: Arrangement, top: Support) -> None:
    """One thing more, one less, one for another, or one that is moved a little or far."""
    kind = str(random.choice(["comes", "goes", "exchanged", "nudged", "moved"]))
    thing = _TABLEWARE(random)
    # Room for what comes in its place, and for a nudge.
    clearance = {"exchanged": 0.03, "nudged": 0.08}.get(kind, 0.0)
    pose = top.pose(random, thing, clearance)
    if pose is None:
        return
    standing = moved(thing, pose)
    if kind in ("comes", "goes"):
        arrangement.comes_or_goes(standing, comes=kind == "comes")
    elif kind == "exchanged":
        arrangement.change(before=standing)
        arrangement.change(after=moved(_another(random, thing), pose))
    elif kind == "nudged":
        arrangement.moves(standing, displaced(random, pose, (0.015, 0.08), 1.0 if chance(random, 0.5) else 0.0))
    elif (there := top.pose(random, thing)) is not None:
        arrangement.moves(standing, there @ np.linalg.inv(pose))


def _another(random: np.random.Generator, thing: StandingObject) -> StandingObject:
    """A thing that fits in the place of the other, and differs from it by 2 cm in height or in radius."""
    while True:
        other = _TABLEWARE(random)
        wider, higher = footprint(other) - footprint(thing), height(other) - height(thing)
        if wider < 0.03 and max(abs(wider), abs(higher)) > 0.02:
            return other


def _stand(random: np.random.Generator, arrangement: Arrangement, top: Support) -> None:
    """A thing that stays; on a box now and then another, which in a scene with changes may come or go."""
    thing = _TABLEWARE(random)
    pose = top.pose(random, thing)
    if pose is None:
        return
    standing = moved(thing, pose)
    arrangement.stays(standing)
    if type(thing[0]) is not Solid or chance(random, 0.4):
        return
    upper = _TABLEWARE(random)
    lifted = top_of(standing[0]).pose(random, upper)
    if lifted is None:
        return
    if arrangement.changes > 0 and chance(random, 0.5):
        arrangement.comes_or_goes(moved(upper, lifted), comes=chance(random, 0.5))
    else:
        arrangement.stays(moved(upper, lifted))


def _halves(
    random: np.random.Generator, camera: TriangulatingCamera, arrangement: Arrangement, poses: np.ndarray
) -> Pair[Recording]:
    """One frame, its even pixels before and its odd ones after; what is not there at one time is cut out of it.

    Where both times show different things the frame shows all of them, and nothing lies where one of them hides it.
    """
    cut_out = chance(random, 0.6)
    everything = [*arrangement.solids.before, *(solid for solid in arrangement.solids.after if solid.label >= 0)]
    distortion = camera.distortion_of(random)
    rows, columns = np.indices((camera.camera.rows, camera.camera.columns))
    even = ((rows + columns) % 2 == 0).ravel()

    def half(solids: list[Solid], pixels: Bool[np.ndarray, " n"]) -> Recording:
        points, labels = camera.frame(everything if cut_out else solids, poses[0], distortion, random, pixels)
        there = np.isin(labels, [UNLABELLED, *(solid.label for solid in solids)])
        return camera.joined([(points[there], labels[there])], poses)

    return each(half, arrangement.solids, Pair(even, ~even))
