"""Solids that rays hit, with what they stand for: boxes and cylinders here, other shapes in `shapes`."""

import dataclasses
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.geometry import rigid_transform

UNLABELLED = -1


@dataclasses.dataclass(frozen=True, eq=False)
class Solid:
    """A box or a cylinder; a subclass has another shape within the same extent.

    Attributes:
        centre: its centre, metres.
        extent: full edge lengths along its own axes; of a cylinder twice the diameter and the height.
        yaw: turn about the vertical, radians.
        round: whether it is a cylinder about its third axis.
        label: number of the change, or of the thing, that it belongs to; `UNLABELLED` for none.
        axes: its axes as columns, in place of the yaw; None: it stands upright, turned by the yaw.
    """

    centre: Float[np.ndarray, "3"]
    extent: Float[np.ndarray, "3"]
    yaw: float = 0.0
    round: bool = False
    label: int = UNLABELLED
    axes: Float[np.ndarray, "3 3"] | None = None

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Its axes as columns."""
        if self.axes is not None:
            return self.axes
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])

    def pose(self) -> Float[np.ndarray, "4 4"]:
        """Its own coordinates to the world's."""
        return rigid_transform(self.rotation, self.centre)

    def moved(self, motion: Float[np.ndarray, "4 4"]) -> "Solid":
        """It after a rigid motion of the world."""
        centre = motion[:3, :3] @ self.centre + motion[:3, 3]
        return dataclasses.replace(self, centre=centre, axes=motion[:3, :3] @ self.rotation)

    def contains(self, points: Float[np.ndarray, "n 3"], margin: float = 0.0) -> Bool[np.ndarray, " n"]:
        """Mask of the points inside, or outside by no more than the margin on each axis."""
        own = (points - self.centre) @ self.rotation
        half = self.extent / 2 + margin
        if self.round:
            return np.asarray((np.hypot(own[:, 0], own[:, 1]) <= half[0]) & (np.abs(own[:, 2]) <= half[2]))
        return np.asarray((np.abs(own) <= half).all(axis=1))

    def ranges(self, origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Range at which each ray, of unit direction, hits it from outside; inf where it misses."""
        start, along = (origin - self.centre) @ self.rotation, directions @ self.rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.hits(start, along)

    def hits(self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """`ranges` in its own coordinates: the middle of its extent is the origin."""
        return _cylinder(start, along, self.extent / 2) if self.round else _box(start, along, self.extent / 2)


# The solids of one object, the lowest first.
StandingObject: TypeAlias = tuple[Solid, ...]


def cast(
    solids: Sequence[Solid], origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """The range of the first hit of each ray, inf where there is none, and the label of what it hits."""
    nearest, labels = np.full(len(directions), np.inf), np.full(len(directions), UNLABELLED)
    for solid in solids:
        rays = _towards(solid, origin, directions)
        ranges = solid.ranges(origin, directions[rays])
        nearer = ranges < nearest[rays]
        nearest[rays[nearer]], labels[rays[nearer]] = ranges[nearer], solid.label
    return nearest, labels


def _towards(solid: Solid, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The rays that come as near to the solid's centre as its corners are: no other can hit it."""
    centre, reach = solid.centre - origin, float(np.linalg.norm(solid.extent)) / 2
    distance = float(np.linalg.norm(centre))
    if distance <= reach:
        return np.arange(len(directions))
    least = np.sqrt(distance**2 - reach**2) * (1 - 1e-9)
    return np.flatnonzero(directions @ centre >= least)


def behind_edges(image: Float[np.ndarray, "rows columns"], jump: float) -> Float[np.ndarray, "rows columns"]:
    """The range of an adjacent pixel where that is farther by more than the jump, and the own range elsewhere.

    A beam that hits both surfaces there returns something between them.
    """
    behind = image.copy()
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        for near, far in ((one, other), (other, one)):
            behind[near] = np.where(image[far] - image[near] > jump, image[far], behind[near])
    return behind


def through_box(
    start: Float[np.ndarray, "3"], along: Float[np.ndarray, "n 3"], half: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Ranges at which each ray enters and leaves a box about the origin; a ray that misses leaves before it enters."""
    first, second = (-half - start) / along, (half - start) / along
    return np.nanmax(np.minimum(first, second), axis=1), np.nanmin(np.maximum(first, second), axis=1)


def _box(start: np.ndarray, along: np.ndarray, half: np.ndarray) -> np.ndarray:
    """The slabs of the three axes are entered and left; the box is where all are."""
    enters, leaves = through_box(start, along, half)
    return np.where((enters <= leaves) & (enters > 0), enters, np.inf)


def _cylinder(start: np.ndarray, along: np.ndarray, half: np.ndarray) -> np.ndarray:
    quadratic = (along[:, :2] ** 2).sum(axis=1)
    linear = along[:, :2] @ start[:2]
    root = linear**2 - quadratic * (start[:2] @ start[:2] - half[0] ** 2)
    side = (-linear - np.sqrt(np.where(root >= 0, root, np.nan))) / quadratic
    on_side = (side > 0) & (np.abs(start[2] + side * along[:, 2]) <= half[2])
    lid = (np.sign(start[2]) * half[2] - start[2]) / along[:, 2]
    across = start[:2] + lid[:, None] * along[:, :2]
    on_lid = (lid > 0) & ((across**2).sum(axis=1) <= half[0] ** 2) & (abs(start[2]) > half[2])
    return np.fmin(np.where(on_side, side, np.inf), np.where(on_lid, lid, np.inf))
