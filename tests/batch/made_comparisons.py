"""Comparisons of a series as a perfect detector would give them, of boxes whose places are given."""

import dataclasses

import numpy as np

from gmmjax.batch import Comparison, Coverage
from gmmjax.changes import Registration, change_of
from gmmjax.geometry import transformed
from gmmjax.pair import Pair
from tests.changes.scanned_objects import box, motion, placed

EXTENT = (0.4, 0.28, 0.22)
SPACING = 0.03


@dataclasses.dataclass(frozen=True)
class BoxAt:
    """A box that is in a place in each epoch, x, y and yaw, or None.

    Attributes:
        places: one for each epoch.
        extent: edge lengths.
        moves_seen: whether the detector recognises it where it moved.
    """

    places: tuple
    extent: tuple = EXTENT
    moves_seen: bool = True

    def pose(self, epoch):
        x, y, yaw = self.places[epoch]
        return motion(yaw, [x, y, self.extent[2] / 2])

    def points(self, epoch, seed):
        """A scan of it, with noise of its own."""
        return placed(box(seed, self.extent, density=1 / SPACING**2, noise=0.003), self.pose(epoch))


def frames(count, seed=0, shift=0.3):
    """A rigid motion for each epoch, from the world to its coordinates; the first one is none."""
    random = np.random.default_rng(seed)
    return [np.eye(4)] + [motion(random.uniform(-0.3, 0.3), random.uniform(-shift, shift, 3)) for _ in range(count - 1)]


def compared(things, before, after, frame, order=None, hidden=()):
    """What is found between two epochs.

    Args:
        things: of the world.
        before: index of the earlier epoch.
        after: of the later one.
        frame: of each epoch.
        order: permutation that renumbers the changes; None: as they are.
        hidden: x coordinates (least, greatest) of the world that the later epoch did not observe.
    """
    world, to_frame = [], frame[before]
    for index, thing in enumerate(things):
        was, now = thing.places[before], thing.places[after]
        if was == now or _out_of_sight(hidden, was) or _out_of_sight(hidden, now):
            continue
        moved = was is not None and now is not None and thing.moves_seen
        transform = None
        if moved:
            transform = to_frame @ thing.pose(after) @ np.linalg.inv(thing.pose(before)) @ np.linalg.inv(to_frame)
        for side, (place, epoch) in enumerate(((was, before), (now, after))):
            if place is not None:
                points = transformed(thing.points(epoch, 100 * index + epoch), to_frame)
                kind = "moved" if moved else ("disappeared", "appeared")[side]
                partner = (len(world) + 1, len(world) - 1)[side] if moved else None
                change = change_of(points, kind, 0.9 + 0.01 * index, 9.0)
                moved_probability = 0.8 if moved else None
                world.append(
                    (
                        side,
                        points,
                        dataclasses.replace(
                            change, partner=partner, transform=transform, moved_probability=moved_probability
                        ),
                    )
                )
    order = list(range(len(world))) if order is None else [index for index in order if index < len(world)]
    number = {old: new for new, old in enumerate(order)}
    changes = [
        dataclasses.replace(
            world[old][2], partner=None if world[old][2].partner is None else number[world[old][2].partner]
        )
        for old in order
    ]
    return Comparison(
        epochs=Pair(before, after),
        changes=tuple(changes),
        registration=Registration(to_frame @ np.linalg.inv(frame[after]), applied=True),
        sides=tuple(world[old][0] for old in order),
        points=tuple(world[old][1] for old in order),
        coverage=Pair(_floor(to_frame, hidden), Coverage()),
    )


def chain(things, frame=None, **options):
    """Each epoch against its predecessor."""
    count = len(things[0].places)
    frame = frames(count) if frame is None else frame
    return [compared(things, epoch - 1, epoch, frame, **options) for epoch in range(1, count)]


def _out_of_sight(hidden, place):
    return bool(hidden) and place is not None and hidden[0] <= place[0] <= hidden[1]


def _floor(frame, hidden):
    if not hidden:
        return Coverage()
    steps = np.arange(-4.0, 4.0, 0.2)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    points = np.stack([x, y, np.zeros_like(x)], axis=1)
    return Coverage(transformed(points, frame), (hidden[0] <= x) & (x <= hidden[1]))
