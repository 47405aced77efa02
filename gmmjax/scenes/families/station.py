"""Modules of a space station: no floor, no gravity, racks all around, bags of standard sizes that float."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair
from gmmjax.scenes.families.cameras import again, kept_frames, recorded, time_of_flight_camera
from gmmjax.scenes.families.staging import Place, Space, Support, staged
from gmmjax.scenes.families.things import ball, block, box, chance, clutter, moved, one_of, pillar, screen
from gmmjax.scenes.ray_casting import Solid, StandingObject
from gmmjax.scenes.recording import drawn_density
from gmmjax.scenes.rigid_motions import looking_at
from gmmjax.scenes.shapes import Ellipsoid
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

# Cargo transfer bags: half, single, double and triple, metres.
_BAGS = ((0.42, 0.25, 0.24), (0.5, 0.42, 0.25), (0.5, 0.48, 0.42), (0.75, 0.5, 0.42))


def station(random: np.random.Generator) -> SurveyedScene:
    """Modules of about 2 x 2 x 6 m, among whose racks bags, many of them alike, come, go and move, by depth camera."""
    size = random.uniform([3.5, 1.8, 1.8], [7.5, 2.5, 2.5])
    solids = _staged(random, size)
    frames = int(random.integers(14, 26))
    camera = time_of_flight_camera(random, columns=72, max_range=4.0)
    first = _poses(random, size, frames)
    near = chance(random, 0.7)
    second = again(random, first, random.uniform(0.05, 0.3), 8.0) if near else _poses(random, size, frames)
    poses = kept_frames(random, Pair(first, second), random.choice([0.0, random.uniform(0.1, 0.3)]))
    recordings = drawn_density(random, recorded(random, solids, poses, camera))
    frame = Frame.drawn(random, shift=0.03, degrees=0.6, any_way_up=True)
    return surveyed_scene(solids, recordings, frame, hidden_by=0.04)


def _staged(random: np.random.Generator, size: np.ndarray) -> Pair[list[Solid]]:
    """Things on the racks and in the air between."""
    faces = (Support(_side(side, size), (float(size[0]), 0.7 * float(size[1 + side % 2])), 0.6) for side in range(4))
    places: list[Place] = [Space(size * [0.95, 0.75, 0.75]), *faces]
    # A few sizes in one module: that is what makes things look alike.
    sizes = [_BAGS[int(index)] for index in random.integers(len(_BAGS), size=int(random.integers(1, 4)))]

    def bag(own: np.random.Generator) -> StandingObject:
        extent = np.array(sizes[int(own.integers(len(sizes)))])
        bulging = block(extent * [0.8, 0.8, 0.3], (0.0, 0.0, 0.88 * extent[2]), Ellipsoid)
        return (block(extent),) if chance(own, 0.6) else (block(extent), bulging)

    drawn = one_of(bag, bag, bag, box, ball, screen, clutter)
    fixed = _module(random, size)
    return staged(random, fixed, places, drawn, int(random.integers(1, 6)))


def _module(random: np.random.Generator, size: np.ndarray) -> list[Solid]:
    """Racks on four sides, two ends with hatches, and handrails; its long axis is x."""
    solids: list[Solid] = []
    for side in range(4):
        frame = _side(side, size)
        solids.append(block((size[0] + 0.2, max(size[1:]) + 0.4, 0.05), (0.0, 0.0, -0.15)).moved(frame))
        solids += moved(_racks(random, size[0], size[1 + side % 2]), frame)
    for end in (-1.0, 1.0):
        wall = Solid(np.array([end * (size[0] / 2 + 0.05), 0.0, 0.0]), np.array([0.1, size[1] + 0.5, size[2] + 0.5]))
        hatch = pillar(random.uniform(0.8, 1.3), random.uniform(0.05, 0.2))
        turn = Rotation.from_euler("y", -90 * end, degrees=True).as_matrix()
        solids += [wall, hatch.moved(rigid_transform(turn, np.array([end * size[0] / 2, 0.0, 0.0])))]
    return solids


def _racks(random: np.random.Generator, length: float, wide: float) -> list[Solid]:
    """The panels of a side, at depths of their own, and rails on them; the side's face is the plane z = 0."""
    count = max(2, round(length / random.uniform(0.7, 1.1)))
    solids = []
    for index in range(count):
        x = ((index + 0.5) / count - 0.5) * length
        rows = int(random.integers(1, 4))
        for row in range(rows):
            y = ((row + 0.5) / rows - 0.5) * wide
            extent = (0.97 * length / count, 0.97 * wide / rows, 0.12)
            solids.append(block(extent, (x, y, -0.12 - random.uniform(0.0, 0.08))))
        if chance(random, 0.5):
            rail = block((0.03, random.uniform(0.3, 0.6), 0.03), (x - length / count / 2, 0.0, 0.06))
            solids += [rail, block((0.03, 0.03, 0.08), (x - length / count / 2, 0.0, -0.01))]
    return solids


def _side(side: int, size: np.ndarray) -> np.ndarray:
    """The pose of a side's face: its z axis points into the module, its x axis along it."""
    turn = Rotation.from_euler("x", 90 * side, degrees=True).as_matrix()
    return rigid_transform(turn, -turn[:, 2] * size[2 - side % 2] / 2)


def _poses(random: np.random.Generator, size: np.ndarray, frames: int) -> Float[np.ndarray, "v 4 4"]:
    """A free flyer's frames along the module: ahead, back and at the racks, rolled at will."""
    poses = []
    heading = random.uniform(0, 2 * np.pi)
    for index in range(frames):
        along = (index / max(frames - 1, 1) - 0.5) * 0.8 * size[0]
        position = np.array([along, *random.normal(0, 0.12, 2)])
        heading += random.normal(2.4, 0.3)
        direction = np.array([random.normal(0, 0.9), np.cos(heading), np.sin(heading)])
        pose = looking_at(position, position + direction)
        roll = Rotation.from_euler("z", random.uniform(-np.pi, np.pi)).as_matrix()
        poses.append(pose @ rigid_transform(roll))
    return np.stack(poses)
