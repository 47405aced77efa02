"""Simulated series: a room that a depth camera surveys again and again, in which things come, move and go, with truth.

Every survey has noise of its own, a small misregistration, and some points of other sides of the things.
"""

import dataclasses

import numpy as np

from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.geometry import transformed
from gmmjax.scenes import DepthCamera, PoseErrors, Solid, looking_at, recorded_frames, small_motion, standing_at

# Half the inner width of the room, metres.
HALF_WIDTH = 1.3


@dataclasses.dataclass(frozen=True)
class Thing:
    """A thing of a series.

    Attributes:
        parts: solids that stand at the origin.
        places: x, y and yaw for each epoch; None where the thing is not there.
    """

    parts: tuple[Solid, ...]
    places: tuple[tuple[float, float, float] | None, ...]

    def events(self):
        """The true history: kind and epoch."""
        found = []
        for epoch, (was, now) in enumerate(zip(self.places, self.places[1:], strict=False), 1):
            if was != now:
                found.append(("came" if was is None else "went" if now is None else "moved", epoch))
        return tuple(found)

    def at(self, epoch):
        place = self.places[epoch]
        return () if place is None else standing_at(self.parts, np.array([*place[:2], 0.0]), place[2])


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """The surveys of a series.

    Attributes:
        clouds: with the poses that the camera believed in.
        things: with their truth.
        misregistrations: rigid motion of each cloud.
    """

    clouds: tuple[PointCloud, ...]
    things: tuple[Thing, ...]
    misregistrations: tuple[np.ndarray, ...]

    def truth(self):
        """The number of each thing that changed, with its events."""
        return [(number, thing.events()) for number, thing in enumerate(self.things) if thing.events()]

    def told(self, history):
        """A history as those of the truth; the thing is the one that was next to its first event."""
        event = history.events[0]
        there = event.epoch if event.kind == "came" else event.previous
        box = event.origin if event.kind == "moved" else event.box
        middle = transformed(box.centre[None], np.linalg.inv(self.misregistrations[history.frame]))[0]
        places = {number: thing.places[there] for number, thing in enumerate(self.things) if thing.places[there]}
        nearest = min(places, key=lambda number: np.hypot(*(middle[:2] - places[number][:2])), default=-1)
        return nearest, tuple((event.kind, event.epoch) for event in history.events)


def series(seed, epochs=6, things=6, misregistration=(0.015, 0.4), voxel=0.015, lost=0):
    """A random series.

    Args:
        seed: of everything.
        epochs: number of surveys.
        things: that come, move, go or stay, up to twelve.
        misregistration: largest translation, metres, and rotation, degrees, of each survey but the first.
        voxel: edge length of the voxels in which a survey is fused, metres.
        lost: most frames of the 16 of a survey that are lost, one after the other.
    """
    random = np.random.default_rng(seed)
    spots = _spots(random)
    homes = [spots.pop() for _ in range(things)]
    drawn = [Thing(_parts(random), _places(random, epochs, home, spots)) for home in homes]
    wrong = [np.eye(4)]
    wrong += [small_motion(random, *random.uniform(0, misregistration)) for _ in range(epochs - 1)]
    clouds = [_survey(random, drawn, epoch, motion, voxel, lost) for epoch, motion in enumerate(wrong)]
    return Series(tuple(clouds), tuple(drawn), tuple(wrong))


def _spots(random):
    """Places on a grid, each used once."""
    grid = [(x, y) for x in (-0.85, -0.28, 0.28, 0.85) for y in (-0.85, 0.0, 0.85)]
    return [tuple(np.array(grid[index]) + random.uniform(-0.05, 0.05, 2)) for index in random.permutation(len(grid))]


def _parts(random):
    """A box, a drum, or a box on a box."""
    extent = random.uniform(0.2, 0.38, 3)
    kind = random.integers(3)
    if kind == 1:
        extent[1] = extent[0]
    base = Solid(np.array([0.0, 0.0, extent[2] / 2]), extent, round=bool(kind == 1))
    if kind != 2:
        return (base,)
    upper = extent * random.uniform(0.5, 0.8, 3)
    return base, Solid(np.array([0.0, 0.0, extent[2] + upper[2] / 2]), upper)


def _places(random, epochs, home, spots):
    """Comes at some time or is there, goes or stays, and moves up to twice where there is room left."""
    comes = int(random.integers(1, epochs - 1)) if random.random() < 0.5 else 0
    goes = int(random.integers(comes + 1, epochs)) if random.random() < 0.5 else epochs
    moves = {int(epoch) for epoch in random.integers(1, epochs, 2) if comes < epoch < goes and random.random() < 0.5}
    here, places = _standing(random, home), []
    for epoch in range(epochs):
        if epoch in moves and spots:
            here = _standing(random, spots.pop())
        places.append(here if comes <= epoch < goes else None)
    return tuple(places)


def _standing(random, spot):
    return (float(spot[0]), float(spot[1]), float(random.uniform(0, np.pi)))


def _survey(random, things, epoch, wrong, voxel, lost):
    solids = [*_room(), *(part for thing in things for part in thing.at(epoch))]
    camera = DepthCamera(columns=72, rows=56, noise=0.006, flying=0.03)
    poses = _poses(random)[int(random.integers(lost + 1)) :]
    recording = recorded_frames(camera, solids, poses, random, PoseErrors(0.003, 0.1)).fused(voxel)
    views = recording.views
    return PointCloud.from_rows(
        transformed(recording.points, wrong),
        views=SensorViews(wrong @ views.poses, views.field_of_view, views.max_range),
    )


def _poses(random):
    """From around the room, looking inward and down; some outward."""
    start = random.uniform(0, 2 * np.pi)
    poses = []
    for index in range(16):
        angle = start + 2 * np.pi * index / 16
        around = np.array([np.cos(angle), np.sin(angle)])
        inward = index % 4 != 3
        position = np.array([*((1.05 if inward else -0.3) * around), 1.35]) + random.normal(0, 0.03, 3)
        target = np.array([*((-0.45 if inward else 1.0) * around), 0.1]) + random.normal(0, 0.05, 3)
        poses.append(looking_at(position, target))
    return np.stack(poses)


def _room():
    wide, wall, height = 2 * HALF_WIDTH, 0.1, 1.6
    solids = [Solid(np.array([0.0, 0.0, -wall / 2]), np.array([wide + 2 * wall, wide + 2 * wall, wall]))]
    for side in (-1.0, 1.0):
        away = side * (HALF_WIDTH + wall / 2)
        solids.append(Solid(np.array([away, 0.0, height / 2]), np.array([wall, wide + 2 * wall, height])))
        solids.append(Solid(np.array([0.0, away, height / 2]), np.array([wide, wall, height])))
    # What is fixed to the walls keeps the registration from sliding along them.
    solids.append(Solid(np.array([0.5, HALF_WIDTH - 0.08, 0.8]), np.array([0.5, 0.16, 0.4])))
    solids.append(Solid(np.array([0.08 - HALF_WIDTH, -0.4, 0.6]), np.array([0.16, 0.4, 0.5])))
    return solids
