"""Convex bodies, and rays from anywhere against them; things are made of several."""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

UNCHANGED, UNJUDGED = -1, -2


@dataclasses.dataclass(frozen=True, eq=False)
class Body:
    """A box, a cylinder about its third axis, or an ellipsoid.

    Attributes:
        shape: which of them.
        centre: in the world, metres.
        half: half its extent along its own axes; the first one of a cylinder is its radius.
        axes: its axes as columns.
    """

    shape: Literal["box", "cylinder", "ellipsoid"]
    centre: np.ndarray
    half: np.ndarray
    axes: np.ndarray

    def moved(self, rotation: np.ndarray, translation: np.ndarray) -> "Body":
        return dataclasses.replace(self, centre=rotation @ self.centre + translation, axes=rotation @ self.axes)

    def spans(self, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where each ray enters it and where it leaves it; a ray that misses it leaves first."""
        start, along = (origins - self.centre) @ self.axes, directions @ self.axes
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.shape == "box":
                return _slabs(start, along, self.half)
            if self.shape == "ellipsoid":
                return _ball(start / self.half, along / self.half)
            sides = _ball(start[..., :2] / self.half[0], along[:, :2] / self.half[0])
            lids = _slabs(start[..., 2:], along[:, 2:], self.half[2:])
            return np.maximum(sides[0], lids[0]), np.minimum(sides[1], lids[1])

    def normals(self, places: np.ndarray) -> np.ndarray:
        """Unit normals at places on its surface."""
        own = (places - self.centre) @ self.axes
        if self.shape == "ellipsoid":
            normals = own / self.half**2
        elif self.shape == "box":
            normals = _sharpest(np.abs(own) / self.half) * np.sign(own)
        else:
            sides = np.hypot(own[:, 0], own[:, 1])
            on_lid = np.abs(own[:, 2]) - self.half[2] > sides - self.half[0]
            normals = np.where(on_lid[:, None], own * (0, 0, 1), own * (1, 1, 0))
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True) @ self.axes.T)

    def distances(self, places: np.ndarray) -> np.ndarray:
        """How far places are from its surface, from inside too; of an ellipsoid to first order."""
        own = np.abs((places - self.centre) @ self.axes)
        if self.shape == "ellipsoid":
            level = np.linalg.norm(own / self.half, axis=1)
            slope = np.linalg.norm(own / self.half**2, axis=1)
            return np.asarray(np.abs(level - 1) * level / np.maximum(slope, 1e-9))
        if self.shape == "cylinder":
            own = np.stack([np.hypot(own[:, 0], own[:, 1]), own[:, 2]], axis=1)
        outside = own - (self.half if self.shape == "box" else self.half[[0, 2]])
        return np.abs(np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0))


@dataclasses.dataclass(frozen=True, eq=False)
class Thing:
    """Bodies that stay together, with what became of them.

    Attributes:
        bodies: that it is made of.
        change: number of its change; `UNCHANGED`: it is there at both times, in one place.
        free_path: mean depth that a ray reaches in it, metres: leaves, which are others for every ray; 0: it is solid.
    """

    bodies: tuple[Body, ...]
    change: int = UNCHANGED
    free_path: float = 0.0

    @functools.cached_property
    def sphere(self) -> tuple[np.ndarray, float]:
        """Centre and radius of a sphere about it."""
        centres = np.array([body.centre for body in self.bodies])
        middle = (centres.min(axis=0) + centres.max(axis=0)) / 2
        reaches = [np.linalg.norm(body.centre - middle) + np.linalg.norm(body.half) for body in self.bodies]
        return middle, float(max(reaches))

    def moved(self, rotation: np.ndarray, translation: np.ndarray) -> "Thing":
        return dataclasses.replace(self, bodies=tuple(body.moved(rotation, translation) for body in self.bodies))

    def placed(self, position: Sequence[float] | np.ndarray, yaw: float = 0.0) -> "Thing":
        """It turned about the vertical by `yaw` radians, then shifted."""
        return self.moved(Rotation.from_euler("z", yaw).as_matrix(), np.asarray(position, float))


class Hits(NamedTuple):
    """What each ray meets first.

    Attributes:
        ranges: inf where it meets nothing.
        thing: its index; -1 where there is none.
        facing: cosine between the ray and the surface's normal.
    """

    ranges: np.ndarray
    thing: np.ndarray
    facing: np.ndarray


def first_hits(
    things: Sequence[Thing], origins: np.ndarray, directions: np.ndarray, random: np.random.Generator
) -> Hits:
    """Casts rays of unit direction [n, 3] from one place [3] or from a place each [n, 3].

    Args:
        things: that may be met.
        origins: of the rays.
        directions: of the rays.
        random: of what stops a ray among leaves.
    """
    hits = Hits(np.full(len(directions), np.inf), np.full(len(directions), -1), np.ones(len(directions)))
    for number, thing in enumerate(things):
        rays = _near_rays(thing, origins, directions)
        if not len(rays):
            continue
        starts, along = origins if origins.ndim == 1 else origins[rays], directions[rays]
        for body in thing.bodies:
            ranges = _stops(body, thing.free_path, starts, along, random)
            nearer = np.flatnonzero(ranges < hits.ranges[rays])
            own = rays[nearer]
            hits.ranges[own], hits.thing[own] = ranges[nearer], number
            if thing.free_path:
                hits.facing[own] = 0.7
            else:
                places = (starts if starts.ndim == 1 else starts[nearer]) + ranges[nearer, None] * along[nearer]
                hits.facing[own] = np.abs((body.normals(places) * along[nearer]).sum(axis=1))
    return hits


def distances(things: Sequence[Thing], places: np.ndarray, most: float) -> np.ndarray:
    """How far places [n, 3] are from the nearest surface of any solid thing; `most` where none is as near."""
    nearest = np.full(len(places), most)
    for thing in things:
        if thing.free_path:
            continue
        centre, radius = thing.sphere
        near = np.flatnonzero(((places - centre) ** 2).sum(axis=1) < (radius + most) ** 2)
        for body in thing.bodies:
            nearest[near] = np.minimum(nearest[near], body.distances(places[near]))
    return nearest


def box(width: float, depth: float, height: float, at: Sequence[float] = (0, 0, 0), yaw: float = 0.0) -> Body:
    """An upright one that stands on the place."""
    return Body(
        "box",
        np.array([at[0], at[1], at[2] + height / 2]),
        np.array([width, depth, height]) / 2,
        Rotation.from_euler("z", yaw).as_matrix(),
    )


def pole(radius: float, height: float, at: Sequence[float] = (0, 0, 0)) -> Body:
    """An upright cylinder that stands on the place."""
    half = np.array([radius, radius, height / 2])
    return Body("cylinder", np.array([at[0], at[1], at[2] + height / 2]), half, np.eye(3))


def pipe(radius: float, length: float, at: Sequence[float] = (0, 0, 0)) -> Body:
    """A cylinder along x that lies on the place."""
    axes = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    return Body("cylinder", np.array([at[0], at[1], at[2] + radius]), np.array([radius, radius, length / 2]), axes)


def ellipsoid(half: Sequence[float], at: Sequence[float] = (0, 0, 0), axes: np.ndarray | None = None) -> Body:
    """One about a place."""
    return Body("ellipsoid", np.asarray(at, float), np.asarray(half, float), np.eye(3) if axes is None else axes)


def _near_rays(thing: Thing, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The rays that pass the sphere about the thing, or start in it."""
    centre, radius = thing.sphere
    towards = centre - origins
    square = (towards**2).sum(axis=-1)
    ahead = directions @ towards if origins.ndim == 1 else np.einsum("ij,ij->i", directions, towards)
    return np.flatnonzero((square <= radius**2) | ((ahead > 0) & (ahead**2 >= square - radius**2)))


def _stops(
    body: Body, free_path: float, origins: np.ndarray, directions: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    enters, leaves = body.spans(origins, directions)
    if free_path:
        stop = np.maximum(enters, 0.0) + random.exponential(free_path, len(directions))
        return np.where(stop < leaves, stop, np.inf)
    return np.where((enters < leaves) & (enters > 0), enters, np.inf)


def _slabs(start: np.ndarray, along: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    first, second = (-half - start) / along, (half - start) / along
    return np.fmax.reduce(np.fmin(first, second), axis=1), np.fmin.reduce(np.fmax(first, second), axis=1)


def _ball(start: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The unit ball, or the unit circle; a ray that misses it enters at infinity."""
    quadratic, linear = (along**2).sum(axis=1), (start * along).sum(axis=1)
    root = linear**2 - quadratic * ((start**2).sum(axis=-1) - 1)
    missed = ~(root > 0)
    root = np.sqrt(np.where(missed, 0.0, root))
    enters, leaves = (-linear - root) / quadratic, (-linear + root) / quadratic
    return np.where(missed, np.inf, enters), np.where(missed, -np.inf, leaves)


def _sharpest(values: np.ndarray) -> np.ndarray:
    """One in the column of each row's largest value, zero elsewhere."""
    return np.asarray(np.arange(values.shape[1]) == values.argmax(axis=1)[:, None], float)
