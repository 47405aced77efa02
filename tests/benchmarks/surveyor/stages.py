"""What stands at a site at either time, and the places that are left on its floor."""

import dataclasses
from collections.abc import Callable

import numpy as np

from gmmjax.pair import Pair
from tests.benchmarks.surveyor.solids import Thing


class Stage:
    """Takes things as they come, go, move or stay; where nothing changes, all of them stay.

    Attributes:
        things: before and after.
    """

    def __init__(self, changed: bool) -> None:
        self.things: Pair[list[Thing]] = Pair([], [])
        self._changed = changed
        self._changes = 0

    def stays(self, *things: Thing) -> None:
        for thing in things:
            self.things.before.append(thing)
            self.things.after.append(thing)

    def goes(self, thing: Thing) -> None:
        self._one_side(self.things.before, thing)

    def comes(self, thing: Thing) -> None:
        self._one_side(self.things.after, thing)

    def moves(self, before: Thing, after: Thing) -> None:
        if not self._changed:
            self.stays(before)
            return
        number = self.next_number()
        self.things.before.append(dataclasses.replace(before, change=number))
        self.things.after.append(dataclasses.replace(after, change=number))

    def next_number(self) -> int:
        self._changes += 1
        return self._changes - 1

    def _one_side(self, side: list[Thing], thing: Thing) -> None:
        if self._changed:
            side.append(dataclasses.replace(thing, change=self.next_number()))
        else:
            self.stays(thing)


class Floor:
    """Places on a level floor that are free: circles that do not overlap.

    Args:
        length: along x; the floor's corner is at the origin.
        width: along y.
        random: of the places.
    """

    def __init__(self, length: float, width: float, random: np.random.Generator) -> None:
        self._size = np.array([length, width])
        self._random = random
        self._taken: list[tuple[np.ndarray, float]] = []

    def reserve(self, place: np.ndarray, radius: float) -> None:
        self._taken.append((np.asarray(place[:2], float), radius))

    def free(self, place: np.ndarray, radius: float) -> bool:
        inside = ((place[:2] > radius) & (place[:2] < self._size - radius)).all()
        return bool(inside and all(np.linalg.norm(place[:2] - at) > radius + own for at, own in self._taken))

    def take(self, radius: float, wanted: Callable[[np.ndarray], bool] = lambda place: True) -> np.ndarray:
        """A free place [3] at a height of zero, which is free no longer; smaller where none of that radius is left."""
        for attempt in range(4000):
            place = np.append(self._random.uniform(0.3, self._size - 0.3), 0.0)
            if self.free(place, radius) and wanted(place):
                self.reserve(place, radius)
                return place
            if attempt % 500 == 499:
                radius *= 0.9
        raise RuntimeError("the floor is full; ask for fewer things")
