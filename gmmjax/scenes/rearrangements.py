"""Rooms and modules without a floor in which things were put elsewhere, turned or shifted, with the true motions.

Boxes, drums, bags of standard sizes, chairs, stacks of two boxes, panels on hinges and drawers. In a room they stand on
the floor; in a module, which has no floor and no gravity, they float in any orientation, and the whole module is
oriented at random.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypeAlias, get_args

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews, voxel_grid
from gmmjax.errors import InputError, check_choice
from gmmjax.geometry import rigid_transform, transformed
from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.ray_casting import UNLABELLED, Solid
from gmmjax.scenes.rigid_motions import looking_at, small_motion

Gravity = Literal["floor", "none"]
InPlace = Literal["turned", "shifted", "door", "drawer", "replaced"]


@dataclasses.dataclass(frozen=True)
class RearrangementSettings:
    """What the scenes are made of. Lengths are in metres, angles in degrees.

    Attributes:
        half_width: half the inner width of a room or module.
        frames: of each survey.
        pixels: of each frame, across and down.
        noise: least and greatest standard deviation of the camera along the ray at 2 m.
        voxel: edge of the voxels that a survey is fused in.
        drift: translation of each frame by its wrong pose.
        misregistration: translation and rotation of the after cloud, at most.
        bags: edge lengths of standard cargo bags; those of one size cannot be told apart.
        look_alikes: fraction of the things that are such bags.
        shift: of a thing that was shifted in its place, least and greatest.
        turn: of one that was turned, least and greatest.
        apart: least distance between the places of two things.
    """

    half_width: float = 1.2
    frames: int = 20
    pixels: tuple[int, int] = (64, 48)
    noise: tuple[float, float] = (0.004, 0.01)
    voxel: float = 0.01
    drift: float = 0.002
    misregistration: tuple[float, float] = (0.0, 0.0)
    bags: tuple[tuple[float, float, float], ...] = ((0.5, 0.42, 0.25), (0.42, 0.25, 0.24), (0.3, 0.25, 0.2))
    look_alikes: float = 0.15
    shift: tuple[float, float] = (0.03, 0.15)
    turn: tuple[float, float] = (5.0, 60.0)
    apart: float = 0.6


@dataclasses.dataclass(frozen=True, eq=False)
class RearrangedScene:
    """Two surveys of a place in which things were rearranged.

    Attributes:
        before: points [n0, 3] of the first survey, metres.
        after: of the second.
        truth_before: per point -1, or the number of the change; a thing that moved has one number in both clouds.
        truth_after: the same for `after`.
        views_before: where the camera stood.
        views_after: the same for `after`.
        motions: by number of each thing that moved, the rigid motion [4, 4] from `before` to `after` as they are given.
        base: by number of each thing that moved, the middle of its base [3] in `before`.
    """

    before: Float[np.ndarray, "n0 3"]
    after: Float[np.ndarray, "n1 3"]
    truth_before: Int[np.ndarray, " n0"]
    truth_after: Int[np.ndarray, " n1"]
    views_before: SensorViews
    views_after: SensorViews
    motions: Mapping[int, Float[np.ndarray, "4 4"]]
    base: Mapping[int, Float[np.ndarray, "3"]]


@dataclasses.dataclass(frozen=True, eq=False)
class _Oriented(Solid):
    """A solid in any orientation."""

    orientation: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(3))

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        return self.orientation


# The parts of one thing, about the middle of its base; and things in their poses.
Thing: TypeAlias = tuple[_Oriented, ...]
Placed: TypeAlias = tuple[Thing, np.ndarray]


def rearranged_scene(
    seed: int,
    gravity: Gravity = "floor",
    *,
    appeared: int = 0,
    disappeared: int = 0,
    moved: int = 1,
    in_place: InPlace | None = None,
    settings: RearrangementSettings = RearrangementSettings(),
) -> RearrangedScene:
    """A random place, surveyed before and after it was rearranged.

    Args:
        seed: of everything random.
        gravity: "floor": a room; "none": a module in which things float.
        appeared: things that are new.
        disappeared: things that are gone.
        moved: things that are elsewhere.
        in_place: one more thing that was turned or shifted in its place, a panel on a hinge, a drawer, or a thing that
            was replaced by another one in the same place; None: none.
        settings: what the scenes are made of.

    Raises:
        InputError: an unknown gravity or motion, or more things than there is room for.
    """
    check_choice("gravity", gravity, get_args(Gravity))
    if in_place is not None:
        check_choice("in_place", in_place, get_args(InPlace))
    random = np.random.default_rng(seed)
    layout = _Layout(random, gravity, settings)
    gone = [layout.placed(layout.thing(number)) for number in range(disappeared)]
    new = [layout.placed(layout.thing(disappeared + number)) for number in range(appeared)]
    moves = [layout.moved(disappeared + appeared + number) for number in range(moved)]
    if in_place == "replaced":
        count = disappeared + appeared + moved
        pose = layout.pose()
        gone.append((layout.thing(count), pose))
        new.append((layout.thing(count + 1), pose))
    elif in_place is not None:
        moves.append(layout.moved_in_place(disappeared + appeared + moved, in_place))
    staying = [layout.placed(layout.thing(UNLABELLED)) for _ in range(2)]
    world = layout.world
    before = [*layout.room, *_solids(staying), *_solids(gone), *_solids((thing, old) for thing, old, _ in moves)]
    after = [*layout.room, *_solids(staying), *_solids(new), *_solids((thing, to) for thing, _, to in moves)]
    surveys = [_survey(random, solids, layout.poses(), settings) for solids in (before, after)]
    wrong = world @ small_motion(random, *settings.misregistration)
    return RearrangedScene(
        transformed(surveys[0][0], world),
        transformed(surveys[1][0], wrong),
        surveys[0][1],
        surveys[1][1],
        surveys[0][2].moved(world),
        surveys[1][2].moved(wrong),
        {thing[0].label: wrong @ to @ np.linalg.inv(world @ old) for thing, old, to in moves},
        {thing[0].label: transformed(old[None, :3, 3], world)[0] for thing, old, _ in moves},
    )


class _Layout:
    """Draws things and free places for them.

    Attributes:
        room: the walls, and the floor.
        world: orientation of the whole place.
    """

    def __init__(self, random: np.random.Generator, gravity: Gravity, settings: RearrangementSettings) -> None:
        self._random, self._floor, self._settings = random, gravity == "floor", settings
        self._taken: list[np.ndarray] = []
        self._height = random.uniform(1.6, 2.0)
        self.room = self._walls()
        self.world = rigid_transform() if self._floor else rigid_transform(Rotation.random(rng=random).as_matrix())

    def _walls(self) -> list[Solid]:
        half, height, thick = self._settings.half_width, self._height, 0.1
        walls: list[Solid] = [_box((0.0, 0.0, -thick / 2), (3 * half, 3 * half, thick))]
        if not self._floor:
            walls.append(_box((0.0, 0.0, height + thick / 2), (3 * half, 3 * half, thick)))
        for axis in (0, 1):
            for side in (-1, 1):
                centre, extent = np.array([0.0, 0.0, height / 2]), np.array([3 * half, 3 * half, height])
                centre[axis], extent[axis] = side * (half + thick / 2), thick
                walls.append(dataclasses.replace(_box((0.0, 0.0, 0.0), extent), centre=centre))
        return walls

    def thing(self, label: int) -> Thing:
        """A thing of a random kind."""
        random = self._random
        if random.random() < self._settings.look_alikes:
            return (
                _box(
                    (0.0, 0.0, 0.0), self._settings.bags[random.integers(len(self._settings.bags))], label, stands=True
                ),
            )
        kind = random.choice(["box", "drum", "chair", "stack", "step"])
        if kind == "chair":
            return _chair(random, label)
        extent = random.uniform(0.18, 0.48, 3)
        base = _box((0.0, 0.0, 0.0), extent, label, stands=True)
        if kind == "drum":
            round_base = np.array([extent[0], extent[0], extent[2]])
            return (dataclasses.replace(_box((0.0, 0.0, 0.0), round_base, label, stands=True), round=True),)
        if kind == "box":
            return (base,)
        upper = extent * random.uniform(0.4, 0.8, 3)
        aside = (extent - upper)[:2] / 2 * (random.uniform(-1, 1, 2) if kind == "stack" else np.array([1.0, 0.0]))
        return base, _box((float(aside[0]), float(aside[1]), float(extent[2])), upper, label, stands=True)

    def pose(self) -> Float[np.ndarray, "4 4"]:
        """A free place: on the floor with any heading, or floating in any orientation.

        Raises:
            InputError: there is none.
        """
        random, settings = self._random, self._settings
        reach = settings.half_width - 0.35
        for attempt in range(2000):
            place = random.uniform(-reach, reach, 3)
            place[2] = 0.0 if self._floor else random.uniform(0.4, self._height - 0.4)
            if all(np.linalg.norm(place - other) > settings.apart * 0.9995**attempt for other in self._taken):
                self._taken.append(place)
                turn = Rotation.from_rotvec([0, 0, random.uniform(0, 2 * np.pi)])
                return rigid_transform((turn if self._floor else Rotation.random(rng=random)).as_matrix(), place)
        raise InputError("there is no room left for so many things; ask for fewer")

    def placed(self, thing: Thing) -> Placed:
        """A thing in a free place."""
        return thing, self.pose()

    def moved(self, label: int) -> tuple[Thing, np.ndarray, np.ndarray]:
        """A thing, where it was and where it is."""
        return self.thing(label), self.pose(), self.pose()

    def moved_in_place(self, label: int, motion: InPlace) -> tuple[Thing, np.ndarray, np.ndarray]:
        """A thing that was turned or shifted in its place, a panel on a hinge, or a drawer with its front."""
        random, settings = self._random, self._settings
        sign = random.choice([-1.0, 1.0])
        if motion == "door":
            wide, high = random.uniform(0.4, 0.7), random.uniform(0.6, 1.2)
            # About the hinge, at the edge.
            panel = (_box((wide / 2, 0.0, 0.0), (wide, 0.03, high), label, stands=True),)
            half = settings.half_width
            hinge = rigid_transform(translation=np.array([random.uniform(-half / 2, 0.1), half - 0.02, 0.25]))
            first = _about_vertical(-random.uniform(0, 20))
            return panel, hinge @ first, hinge @ first @ _about_vertical(-random.uniform(20, 70))
        pose = self.pose()
        if motion == "turned":
            thing = _chair(random, label) if random.random() < 0.5 else self._turnable(label)
            return thing, pose, pose @ _about_vertical(sign * random.uniform(*settings.turn))
        if motion == "drawer":
            return self._drawer(pose, label)
        angle = random.uniform(0, 2 * np.pi)
        direction = np.array([np.cos(angle), np.sin(angle), 0.0])
        return self.thing(label), pose, pose @ rigid_transform(translation=random.uniform(*settings.shift) * direction)

    def _turnable(self, label: int) -> Thing:
        """A thing that looks different after it was turned."""
        thing = self.thing(label)
        while thing[0].round:
            thing = self.thing(label)
        return thing

    def _drawer(self, pose: np.ndarray, label: int) -> tuple[Thing, np.ndarray, np.ndarray]:
        """A drawer of a cabinet, which stays."""
        wide, deep, high = self._random.uniform([0.3, 0.3, 0.25], [0.5, 0.5, 0.4])
        cabinet = (_box((0.0, 0.0, 0.0), (wide, deep, high), stands=True),)
        self.room.extend(_solids([(cabinet, pose)]))
        front = _box((0.0, deep / 2 + 0.01, 0.05), (wide - 0.04, 0.02, high / 2), label, stands=True)
        case = _box((0.0, 0.02, 0.07), (wide - 0.08, deep - 0.02, high / 2 - 0.05), label, stands=True)
        out = rigid_transform(translation=np.array([0, self._random.uniform(0.06, 0.2), 0]))
        return (front, case), pose, pose @ out

    def poses(self) -> Float[np.ndarray, "v 4 4"]:
        """Where the camera stands, around the place, looking across it."""
        random, settings = self._random, self._settings
        start, poses = random.uniform(0, 2 * np.pi), []
        for index in range(settings.frames):
            angle = start + 2 * np.pi * index / settings.frames
            around = np.array([np.cos(angle), np.sin(angle)])
            height = 1.3 if self._floor else (0.15, 0.5, 0.85)[index % 3] * self._height
            position = np.array([*(0.8 * settings.half_width * around), height]) + 0.05 * random.standard_normal(3)
            aim = 0.2 if self._floor else (0.8, 0.5, 0.2)[index % 3] * self._height
            poses.append(looking_at(position, np.array([*(-0.5 * around), aim]) + 0.05 * random.standard_normal(3)))
        return np.stack(poses)


def _chair(random: np.random.Generator, label: int) -> Thing:
    """A seat, a back and four legs."""
    wide, deep, seat = random.uniform([0.35, 0.35, 0.35], [0.45, 0.45, 0.45])
    thick, leg = 0.04, 0.04
    sides = [(x, y) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
    legs = [
        _box((x * (wide - leg) / 2, y * (deep - leg) / 2, 0.0), (leg, leg, seat), label, stands=True) for x, y in sides
    ]
    back = _box((0.0, (thick - deep) / 2, seat), (wide, thick, random.uniform(0.3, 0.45)), label, stands=True)
    return _box((0.0, 0.0, seat), (wide, deep, thick), label, stands=True), back, *legs


def _box(
    centre: tuple[float, float, float],
    extent: tuple[float, float, float] | Float[np.ndarray, " 3"],
    label: int = UNLABELLED,
    stands: bool = False,
) -> _Oriented:
    """A box about its centre, or that stands there."""
    middle = np.array(centre, float)
    middle[2] += stands * extent[2] / 2
    return _Oriented(middle, np.array(extent, float), label=label)


def _about_vertical(degrees: float) -> Float[np.ndarray, "4 4"]:
    return rigid_transform(Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix())


def _solids(placed: Iterable[Placed]) -> list[Solid]:
    """The solids of things in their poses."""
    return [
        dataclasses.replace(part, centre=transformed(part.centre[None], pose)[0], orientation=pose[:3, :3])
        for thing, pose in placed
        for part in thing
    ]


def _survey(
    random: np.random.Generator, solids: Sequence[Solid], poses: np.ndarray, settings: RearrangementSettings
) -> tuple[np.ndarray, np.ndarray, SensorViews]:
    """The fused points, the label of each, and the views."""
    camera = DepthCamera(*settings.pixels, noise=random.uniform(*settings.noise))
    points, labels = [], []
    for pose in poses:
        frame, own = camera.frame(solids, pose, random)
        points.append(frame + settings.drift * random.standard_normal(3))
        labels.append(own)
    views = SensorViews(poses, camera.field_of_view, camera.max_range)
    change = np.concatenate(labels)
    grid = voxel_grid(np.concatenate(points), settings.voxel)
    numbers = np.unique(change)
    votes = [np.bincount(grid.voxel_of_point, change == number, minlength=len(grid.mass)) for number in numbers]
    return grid.points, numbers[np.argmax(votes, axis=0)], views
