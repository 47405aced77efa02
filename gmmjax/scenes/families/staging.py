"""Puts things in free places of a scene, before and after something changed."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair
from gmmjax.scenes.families.things import Drawing, footprint, height, labelled, moved
from gmmjax.scenes.ray_casting import Solid, StandingObject
from gmmjax.scenes.rigid_motions import turned


@dataclasses.dataclass(frozen=True, eq=False)
class Support:
    """A rectangle that things stand on: a floor, the top of a table, a board of a shelf.

    Attributes:
        middle: of the rectangle, its z axis the normal [4, 4].
        size: full edge lengths, metres.
        headroom: what stands here must be lower, metres.
        gap: left free between things, metres.
        overhang: share of a thing's radius that may stand out over the edges.
        taken: middles and radii of the places taken, in the rectangle's coordinates.
    """

    middle: Float[np.ndarray, "4 4"]
    size: tuple[float, float]
    headroom: float = np.inf
    gap: float = 0.05
    overhang: float = 0.0
    taken: list[tuple[np.ndarray, float]] = dataclasses.field(default_factory=list)

    def pose(
        self, random: np.random.Generator, thing: StandingObject, clearance: float = 0.0
    ) -> Float[np.ndarray, "4 4"] | None:
        """A free pose for the thing and this clearance, metres, which it keeps; None where none was found."""
        radius = footprint(thing)
        room = np.array(self.size) / 2 - radius * (1 - self.overhang)
        if (room < 0).any() or height(thing) > self.headroom:
            return None
        for _ in range(30):
            spot = random.uniform(-room, room)
            if self.free(spot, radius, clearance):
                self.taken.append((spot, radius + clearance))
                return np.asarray(self.middle @ turned(random.uniform(0, 2 * np.pi), (*spot, 0.0)))
        return None

    def free(self, spot: Float[np.ndarray, "2"], radius: float, clearance: float = 0.0) -> bool:
        """True if no object stands in a circle, in the rectangle's coordinates."""
        gap = self.gap + clearance
        return all(np.linalg.norm(spot - other) > radius + reach + gap for other, reach in self.taken)


@dataclasses.dataclass(frozen=True, eq=False)
class Space:
    """A box in which things float in any orientation.

    Attributes:
        size: full edge lengths, about the origin, metres.
        taken: middles and radii of the places taken.
    """

    size: Float[np.ndarray, "3"]
    taken: list[tuple[np.ndarray, float]] = dataclasses.field(default_factory=list)

    def pose(self, random: np.random.Generator, thing: StandingObject) -> Float[np.ndarray, "4 4"] | None:
        """A free pose for the thing, which is taken from then on; None where none was found."""
        half = height(thing) / 2
        radius = float(np.hypot(footprint(thing), half))
        free = self.size / 2 - radius
        if (free < 0).any():
            return None
        for _ in range(30):
            spot = random.uniform(-free, free)
            if all(np.linalg.norm(spot - other) > radius + reach + 0.03 for other, reach in self.taken):
                self.taken.append((spot, radius))
                turn = Rotation.from_quat(random.standard_normal(4)).as_matrix()
                return rigid_transform(turn, spot - turn @ [0.0, 0.0, half])
        return None


# Somewhere that things can be.
Place: TypeAlias = Support | Space


def top_of(solid: Solid, headroom: float = np.inf) -> Support:
    """The upper face of a box as a support for what is lower than the headroom, metres."""
    raised = rigid_transform(translation=np.array([0.0, 0.0, solid.extent[2] / 2]))
    size = (float(solid.extent[0]), float(solid.extent[1]))
    return Support(solid.pose() @ raised, size, headroom, gap=0.02, overhang=0.25)


@dataclasses.dataclass
class Arrangement:
    """The solids of both times; every change gets the next number.

    Attributes:
        solids: of the scene before and after.
        changes: how many there are.
    """

    solids: Pair[list[Solid]] = dataclasses.field(default_factory=lambda: Pair([], []))
    changes: int = 0

    def stays(self, solids: Iterable[Solid]) -> None:
        """These are there at both times."""
        standing = list(solids)
        for side in self.solids:
            side.extend(standing)

    def change(self, before: StandingObject = (), after: StandingObject = ()) -> None:
        """One is there before and the other after; the same thing in both has moved."""
        self.solids.before.extend(labelled(before, self.changes))
        self.solids.after.extend(labelled(after, self.changes))
        self.changes += 1

    def comes_or_goes(self, thing: StandingObject, *, comes: bool) -> None:
        """This is there after only, or before only."""
        self.change(*((), thing) if comes else (thing, ()))

    def moves(self, thing: StandingObject, motion: Float[np.ndarray, "4 4"]) -> None:
        """This is there before, and after where the motion brings it."""
        self.change(thing, moved(thing, motion))

    def furnish(self, random: np.random.Generator, places: Sequence[Place], draw: Drawing, count: int) -> None:
        """At most this number of drawn things stays in the places, where they find one."""
        for _ in range(count):
            thing = draw(random)
            pose = _free_pose(random, places, thing)
            self.stays(moved(thing, pose) if pose is not None else ())


def displaced(
    random: np.random.Generator, pose: Float[np.ndarray, "4 4"], shift: tuple[float, float], max_yaw: float
) -> Float[np.ndarray, "4 4"]:
    """A motion of a thing along the floor by least to most, metres, and about the vertical by up to the yaw."""
    direction, yaw = random.uniform(0, 2 * np.pi), random.uniform(-max_yaw, max_yaw)
    there = pose @ Solid(np.zeros(3), np.ones(3), float(yaw)).pose()
    there[:2, 3] += random.uniform(*shift) * np.array([np.cos(direction), np.sin(direction)])
    return np.asarray(there @ np.linalg.inv(pose))


@dataclasses.dataclass(frozen=True)
class Turnover:
    """Largest numbers of objects that appear, disappear and move in a scene; a third of the scenes do not change."""

    appeared: int = 3
    disappeared: int = 3
    moved: int = 2

    def drawn(self, random: np.random.Generator) -> tuple[int, int, int]:
        """Draw the numbers of objects that appear, disappear and move in one scene."""
        if random.random() < 1 / 3:
            return 0, 0, 0
        while True:
            counts = random.integers(0, [self.appeared + 1, self.disappeared + 1, self.moved + 1])
            if counts.any():
                return int(counts[0]), int(counts[1]), int(counts[2])


def staged(
    random: np.random.Generator,
    fixed: Sequence[Solid],
    places: Sequence[Place],
    draw: Drawing,
    staying: int,
    turnover: Turnover = Turnover(),
) -> Pair[list[Solid]]:
    """A scene before and after things came, went and moved among others that stay.

    Args:
        random: of everything.
        fixed: what does not change.
        places: where things can be; each is as likely.
        draw: draws a thing.
        staying: things that stay, where they find a place.
        turnover: how much changes.
    """
    arrangement = Arrangement()
    arrangement.stays(fixed)
    appeared, disappeared, displaced = turnover.drawn(random)
    for here, there in [(True, False)] * disappeared + [(False, True)] * appeared + [(True, True)] * displaced:
        thing = draw(random)
        poses = [_free_pose(random, places, thing) for _ in range(here + there)]
        found = [moved(thing, pose) for pose in poses if pose is not None]
        if len(found) == here + there:
            arrangement.change(found[0] if here else (), found[-1] if there else ())
    arrangement.furnish(random, places, draw, staying)
    return arrangement.solids


def _free_pose(random: np.random.Generator, places: Sequence[Place], thing: StandingObject) -> np.ndarray | None:
    for index in random.permutation(len(places)):
        pose = places[index].pose(random, thing)
        if pose is not None:
            return np.asarray(pose)
    return None
