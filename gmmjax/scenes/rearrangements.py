"""Rooms and modules without a floor in which things were put elsewhere, turned or shifted, with the true motions.

Boxes, drums, bags of standard sizes, chairs, stacks of two boxes, panels on hinges and drawers. In a room they stand on
the floor; in a module, which has no floor and no gravity, they float in any orientation, and the whole module is
oriented at random.
"""

import dataclasses
from collections.abc import Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError, check_choice
from gmmjax.geometry import rigid_transform
from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.families.staging import Arrangement
from gmmjax.scenes.families.things import block, chance, cuboid, moved, pillar
from gmmjax.scenes.ray_casting import Solid, StandingObject
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import looking_at, small_motion
from gmmjax.scenes.surveyed_scene import Frame, SurveyedScene, surveyed_scene

Gravity = Literal["floor", "none"]
InPlace = Literal["turned", "shifted", "door", "drawer", "replaced"]
# What is there before, and what after.
_Change: TypeAlias = tuple[StandingObject, StandingObject]

# Half the inner width of a room or module, metres.
_HALF_WIDTH = 1.2
# Standard cargo bags, metres: those of one size cannot be told apart.
_BAGS = ((0.5, 0.42, 0.25), (0.42, 0.25, 0.24), (0.3, 0.25, 0.2))


@dataclasses.dataclass(frozen=True)
class RearrangementSettings:
    """Settings of a survey of one place. Lengths are in metres, angles in degrees.

    Attributes:
        frames: of each survey.
        pixels: of each frame, across and down.
        voxel: edge of the voxels that a survey is fused in.
        misregistration: translation and rotation of the after cloud.
    """

    frames: int = 20
    pixels: tuple[int, int] = (64, 48)
    voxel: float = 0.01
    misregistration: tuple[float, float] = (0.0, 0.0)


def rearranged_scene(
    seed: int,
    gravity: Gravity = "floor",
    *,
    appeared: int = 0,
    disappeared: int = 0,
    moved: int = 1,
    in_place: InPlace | None = None,
    settings: RearrangementSettings = RearrangementSettings(),
) -> SurveyedScene:
    """A random place, surveyed before and after it was rearranged.

    Args:
        seed: of everything random.
        gravity: "floor": a room; "none": a module in which things float.
        appeared: things that are new.
        disappeared: things that are gone.
        moved: things that are elsewhere.
        in_place: one more thing that was turned or shifted in its place, a panel on a hinge, a drawer, or a thing that
            was replaced by another one in the same place; None: none.
        settings: how the place is surveyed.

    Raises:
        InputError: an unknown gravity or motion, or more things than there is room for.
    """
    check_choice("gravity", gravity, get_args(Gravity))
    if in_place is not None:
        check_choice("in_place", in_place, get_args(InPlace))
    random = np.random.default_rng(seed)
    layout = _Layout(random, gravity == "floor")
    changes: list[_Change] = [(layout.placed(), ()) for _ in range(disappeared)]
    changes += [((), layout.placed()) for _ in range(appeared)]
    changes += [layout.put_elsewhere() for _ in range(moved)]
    if in_place is not None:
        changes += layout.changed_in_place(in_place)
    staying = [layout.placed(), layout.placed()]
    arrangement = Arrangement()
    for thing in (layout.room, *staying):
        arrangement.stays(thing)
    for before, after in changes:
        arrangement.change(before, after)
    recordings = arrangement.solids.map(lambda own: _survey(random, own, layout.poses(settings.frames), settings))
    frame = Frame(small_motion(random, *settings.misregistration), layout.world)
    return surveyed_scene(arrangement.solids, recordings, frame)


class _Layout:
    """Draws things and free places for them.

    Attributes:
        room: the walls, and the floor.
        world: orientation of the whole place.
    """

    def __init__(self, random: np.random.Generator, floor: bool) -> None:
        self._random, self._floor = random, floor
        self._taken: list[np.ndarray] = []
        self._height = random.uniform(1.6, 2.0)
        self.room = self._walls()
        self.world = rigid_transform() if floor else rigid_transform(Rotation.random(rng=random).as_matrix())

    def _walls(self) -> list[Solid]:
        wide, height, thick = 3 * _HALF_WIDTH, self._height, 0.1
        walls = [cuboid((0.0, 0.0, -thick / 2), (wide, wide, thick))]
        if not self._floor:
            walls.append(cuboid((0.0, 0.0, height + thick / 2), (wide, wide, thick)))
        away = _HALF_WIDTH + thick / 2
        walls += [cuboid((side * away, 0.0, height / 2), (thick, wide, height)) for side in (-1, 1)]
        return walls + [cuboid((0.0, side * away, height / 2), (wide, thick, height)) for side in (-1, 1)]

    def thing(self) -> StandingObject:
        """A thing of a random kind, about the middle of its base."""
        random = self._random
        if chance(random, 0.15):
            return (block(_BAGS[random.integers(len(_BAGS))]),)
        kind = random.choice(["box", "drum", "chair", "stack", "step"])
        if kind == "chair":
            return _chair(random)
        extent = random.uniform(0.18, 0.48, 3)
        if kind == "drum":
            return (pillar(extent[0], extent[2]),)
        if kind == "box":
            return (block(extent),)
        upper = extent * random.uniform(0.4, 0.8, 3)
        aside = (extent - upper)[:2] / 2 * (random.uniform(-1, 1, 2) if kind == "stack" else np.array([1.0, 0.0]))
        return block(extent), block(upper, (*aside, extent[2]))

    def pose(self) -> Float[np.ndarray, "4 4"]:
        """A free place: on the floor with any heading, or floating in any orientation.

        Raises:
            InputError: there is none.
        """
        random, reach = self._random, _HALF_WIDTH - 0.35
        for attempt in range(2000):
            place = random.uniform(-reach, reach, 3)
            place[2] = 0.0 if self._floor else random.uniform(0.4, self._height - 0.4)
            if all(np.linalg.norm(place - other) > 0.6 * 0.9995**attempt for other in self._taken):
                self._taken.append(place)
                upright = Rotation.from_rotvec([0, 0, random.uniform(0, 2 * np.pi)])
                return rigid_transform((upright if self._floor else Rotation.random(rng=random)).as_matrix(), place)
        raise InputError("there is no room left for so many things; ask for fewer")

    def placed(self) -> StandingObject:
        """A thing in a free place."""
        return moved(self.thing(), self.pose())

    def put_elsewhere(self) -> _Change:
        """A thing that was in one place and is in another."""
        thing, old, new = self.thing(), self.pose(), self.pose()
        return moved(thing, old), moved(thing, new)

    def changed_in_place(self, motion: InPlace) -> list[_Change]:
        """Objects rotated, shifted or replaced in place, a panel on a hinge, or a drawer with its front."""
        random = self._random
        if motion == "replaced":
            pose = self.pose()
            return [(moved(self.thing(), pose), ()), ((), moved(self.thing(), pose))]
        sign = random.choice([-1.0, 1.0])
        if motion == "door":
            return [self._door()]
        pose = self.pose()
        if motion == "turned":
            thing = _chair(random) if chance(random, 0.5) else self._turnable()
            there = pose @ _about_vertical(sign * random.uniform(5.0, 60.0))
        elif motion == "drawer":
            thing = self._drawer(pose)
            there = pose @ rigid_transform(translation=np.array([0, random.uniform(0.06, 0.2), 0]))
        else:
            angle, thing = random.uniform(0, 2 * np.pi), self.thing()
            shift = random.uniform(0.03, 0.15) * np.array([np.cos(angle), np.sin(angle), 0.0])
            there = pose @ rigid_transform(translation=shift)
        return [(moved(thing, pose), moved(thing, there))]

    def _door(self) -> _Change:
        """A panel that swings about its edge, near a wall."""
        random = self._random
        wide, high = random.uniform(0.4, 0.7), random.uniform(0.6, 1.2)
        panel = (block((wide, 0.03, high), (wide / 2, 0.0, 0.0)),)
        place = np.array([random.uniform(-_HALF_WIDTH / 2, 0.1), _HALF_WIDTH - 0.02, 0.25])
        first = rigid_transform(translation=place) @ _about_vertical(-random.uniform(0, 20))
        return moved(panel, first), moved(panel, first @ _about_vertical(-random.uniform(20, 70)))

    def _turnable(self) -> StandingObject:
        """A thing that looks different after it was turned."""
        thing = self.thing()
        while thing[0].round:
            thing = self.thing()
        return thing

    def _drawer(self, pose: np.ndarray) -> StandingObject:
        """A drawer of a cabinet, which stays."""
        wide, deep, high = self._random.uniform([0.3, 0.3, 0.25], [0.5, 0.5, 0.4])
        self.room.extend(moved((block((wide, deep, high)),), pose))
        front = block((wide - 0.04, 0.02, high / 2), (0.0, deep / 2 + 0.01, 0.05))
        return front, block((wide - 0.08, deep - 0.02, high / 2 - 0.05), (0.0, 0.02, 0.07))

    def poses(self, frames: int) -> Float[np.ndarray, "v 4 4"]:
        """Poses of the camera around the place, looking across it."""
        random = self._random
        start, poses = random.uniform(0, 2 * np.pi), []
        for index in range(frames):
            angle = start + 2 * np.pi * index / frames
            around = np.array([np.cos(angle), np.sin(angle)])
            height = 1.3 if self._floor else (0.15, 0.5, 0.85)[index % 3] * self._height
            position = np.array([*(0.8 * _HALF_WIDTH * around), height]) + 0.05 * random.standard_normal(3)
            aim = 0.2 if self._floor else (0.8, 0.5, 0.2)[index % 3] * self._height
            poses.append(looking_at(position, np.array([*(-0.5 * around), aim]) + 0.05 * random.standard_normal(3)))
        return np.stack(poses)


def _chair(random: np.random.Generator) -> StandingObject:
    """A seat, a back and four legs."""
    wide, deep, seat = random.uniform([0.35, 0.35, 0.35], [0.45, 0.45, 0.45])
    thick, leg = 0.04, 0.04
    sides = [(x, y) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
    legs = [block((leg, leg, seat), (x * (wide - leg) / 2, y * (deep - leg) / 2, 0.0)) for x, y in sides]
    back = block((wide, thick, random.uniform(0.3, 0.45)), (0.0, (thick - deep) / 2, seat))
    return block((wide, deep, thick), (0.0, 0.0, seat)), back, *legs


def _about_vertical(degrees: float) -> Float[np.ndarray, "4 4"]:
    return rigid_transform(Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix())


def _survey(
    random: np.random.Generator, solids: Sequence[Solid], poses: np.ndarray, settings: RearrangementSettings
) -> Recording:
    """The fused frames of a camera, each of which is displaced by 2 mm at random."""
    camera = DepthCamera(*settings.pixels, noise=random.uniform(0.004, 0.01))
    points, places, labels = [], [], []
    for pose in poses:
        frame, own = camera.frame(solids, pose, random)
        points.append(frame + 0.002 * random.standard_normal(3))
        places.append(frame)
        labels.append(own)
    views = SensorViews(poses, camera.field_of_view, camera.max_range)
    recording = Recording(np.concatenate(points), np.concatenate(places), np.concatenate(labels), views, views)
    return recording.fused(settings.voxel)
