"""What stands in a scene before and after a change: things that stay, come, go, are exchanged or moved."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from gmmjax.geometry import rigid_transform, rotation_about
from gmmjax.pair import Pair
from gmmjax.scenes.ray_casting import Solid

# The solids of one thing.
Thing: TypeAlias = tuple[Solid, ...]


@dataclasses.dataclass
class Arrangement:
    """The solids of both times; every change gets the next number.

    Attributes:
        solids: of the scene before and after.
        changes: how many there are.
    """

    solids: Pair[list[Solid]] = dataclasses.field(default_factory=lambda: Pair([], []))
    changes: int = 0

    def stays(self, things: Iterable[Solid]) -> None:
        """These solids are there at both times."""
        standing = list(things)
        for solids in self.solids:
            solids.extend(standing)

    def goes(self, thing: Thing) -> None:
        """This is there before only."""
        self.solids.before.extend(self._labelled(thing))
        self.changes += 1

    def comes(self, thing: Thing) -> None:
        """This is there after only."""
        self.solids.after.extend(self._labelled(thing))
        self.changes += 1

    def moves(self, thing: Thing, motion: Float[np.ndarray, "4 4"]) -> None:
        """This is there before, and after where the motion brings it."""
        labelled = self._labelled(thing)
        self.solids.before.extend(labelled)
        self.solids.after.extend(moved(labelled, motion))
        self.changes += 1

    def _labelled(self, thing: Thing) -> Thing:
        return tuple(dataclasses.replace(part, label=self.changes) for part in thing)


@dataclasses.dataclass
class FreePlaces:
    """Places on a rectangle about the origin that do not touch each other.

    Attributes:
        half: half the edge lengths of the rectangle, metres.
        gap: least distance between things.
        taken: middle and radius of the places that are taken.
    """

    half: Float[np.ndarray, "2"]
    gap: float
    taken: list[tuple[np.ndarray, float]] = dataclasses.field(default_factory=list)

    def take(self, random: np.random.Generator, radius: float) -> np.ndarray | None:
        """A random free place for a thing of this radius, which is taken from now on; None where none is left."""
        room = self.half - radius
        for place in random.uniform(-room, room, (200, 2)) if (room > 0).all() else ():
            if self.is_free(place, radius):
                self.taken.append((place, radius))
                return np.asarray(place)
        return None

    def is_free(self, place: Float[np.ndarray, "2"], radius: float) -> bool:
        """Whether a thing fits there."""
        return all(np.linalg.norm(place - other) > radius + reach + self.gap for other, reach in self.taken)


def moved(thing: Iterable[Solid], motion: Float[np.ndarray, "4 4"]) -> Thing:
    """A thing after a rigid motion of the world."""
    return tuple(part.moved(motion) for part in thing)


def standing_on(place: Sequence[float] | Float[np.ndarray, "3"], yaw: float) -> Float[np.ndarray, "4 4"]:
    """The motion that brings a thing from the origin to a place, turned about the vertical by the yaw, radians."""
    return rigid_transform(about_vertical(yaw), np.asarray(place, float))


def turned_about(
    place: Sequence[float] | Float[np.ndarray, "3"], yaw: float, shift: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0)
) -> Float[np.ndarray, "4 4"]:
    """The rotation about a vertical through a place by the yaw, radians, and then a shift."""
    centre = np.asarray(place, float)
    return rotation_about(about_vertical(yaw), centre, centre + np.asarray(shift, float))


def about_vertical(yaw: float) -> Float[np.ndarray, "3 3"]:
    """The rotation about the vertical, radians."""
    return Solid(np.zeros(3), np.ones(3), yaw).rotation


def box(centre: Sequence[float] | np.ndarray, extent: Sequence[float] | np.ndarray, yaw: float = 0.0) -> Solid:
    """A box that stands upright."""
    return Solid(np.asarray(centre, float), np.asarray(extent, float), yaw)


def cylinder(base: Sequence[float] | np.ndarray, radius: float, height: float) -> Solid:
    """An upright cylinder on its base."""
    centre = np.asarray(base, float) + [0.0, 0.0, height / 2]
    return Solid(centre, np.array([2 * radius, 2 * radius, height]), round=True)


def reach(thing: Iterable[Solid]) -> float:
    """Radius about the vertical through the origin that holds a thing."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    places = np.concatenate([part.centre + (corners * part.extent / 2) @ part.rotation.T for part in thing])
    return float(np.hypot(places[:, 0], places[:, 1]).max())


def height(thing: Iterable[Solid]) -> float:
    """Of the highest point of a thing above the origin: by the corners of its parts."""
    return max(float(part.centre[2] + np.abs(part.rotation[2]) @ part.extent / 2) for part in thing)


def chance(random: np.random.Generator, probability: float) -> bool:
    """Whether something of this probability happens."""
    return bool(random.random() < probability)
