"""Puts things in free places of a scene, before and after something changed."""

import dataclasses
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair
from gmmjax.scenes.families.things import Coordinates, Drawing, footprint, height, labelled, moved
from gmmjax.scenes.objects import StandingObject
from gmmjax.scenes.ray_casting import UNLABELLED, Solid


@dataclasses.dataclass(frozen=True, eq=False)
class Support:
    """A rectangle that things stand on: a floor, the top of a table, a board of a shelf.

    Attributes:
        middle: of the rectangle, its z axis the normal [4, 4].
        size: full edge lengths, metres.
        headroom: what stands here must be lower, metres.
        turned: whether things stand at any angle; else along the edges.
        gap: left free between things, metres.
        overhang: share of a thing's radius that may stand out over the edges.
        taken: middles and radii of the places taken, in the rectangle's coordinates.
    """

    middle: Float[np.ndarray, "4 4"]
    size: tuple[float, float]
    headroom: float = np.inf
    turned: bool = True
    gap: float = 0.05
    overhang: float = 0.0
    taken: list[tuple[np.ndarray, float]] = dataclasses.field(default_factory=list)

    def pose(self, random: np.random.Generator, thing: StandingObject) -> Float[np.ndarray, "4 4"] | None:
        """A free pose for the thing, which is taken from then on; None where none was found."""
        radius = footprint(thing)
        room = np.array(self.size) / 2 - radius * (1 - self.overhang)
        if (room < 0).any() or height(thing) > self.headroom:
            return None
        for _ in range(30):
            spot = random.uniform(-room, room)
            if self.free(spot, radius):
                self.taken.append((spot, radius))
                yaw = random.uniform(0, 2 * np.pi) if self.turned else np.pi / 2 * random.integers(4)
                return np.asarray(self.middle @ turned(float(yaw), (*spot, 0.0)))
        return None

    def free(self, spot: Float[np.ndarray, "2"], radius: float) -> bool:
        """Whether nothing stands in a circle, in the rectangle's coordinates."""
        return all(np.linalg.norm(spot - other) > radius + reach + self.gap for other, reach in self.taken)


@dataclasses.dataclass(frozen=True, eq=False)
class Space:
    """A box in which things float in any orientation.

    Attributes:
        middle: of the box, metres.
        size: full edge lengths.
        taken: middles and radii of the places taken.
    """

    middle: Float[np.ndarray, "3"]
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
            spot = self.middle + random.uniform(-free, free)
            if all(np.linalg.norm(spot - other) > radius + reach + 0.03 for other, reach in self.taken):
                self.taken.append((spot, radius))
                turn = Rotation.from_quat(random.standard_normal(4)).as_matrix()
                return rigid_transform(turn, spot - turn @ [0.0, 0.0, half])
        return None


# Somewhere that things can be.
Place: TypeAlias = Support | Space


def turned(yaw: float, at: Coordinates) -> Float[np.ndarray, "4 4"]:
    """The pose of a thing that stands at a place, turned about the vertical by the yaw, radians."""
    return rigid_transform(Rotation.from_euler("z", yaw).as_matrix(), np.array(at, float))


def top_of(solid: Solid, headroom: float = np.inf) -> Support:
    """The upper face of a box as a support for what is lower than the headroom, metres."""
    raised = rigid_transform(translation=np.array([0.0, 0.0, solid.extent[2] / 2]))
    size = (float(solid.extent[0]), float(solid.extent[1]))
    return Support(solid.pose() @ raised, size, headroom, gap=0.02, overhang=0.25)


@dataclasses.dataclass(frozen=True)
class Turnover:
    """How much of a scene changes.

    Attributes:
        unchanged: share of the scenes in which nothing does.
        appeared: most things that come.
        disappeared: most that go.
        moved: most that move.
    """

    unchanged: float = 1 / 3
    appeared: int = 3
    disappeared: int = 3
    moved: int = 2

    def drawn(self, random: np.random.Generator) -> tuple[int, int, int]:
        """How many things come, go and move in one scene."""
        if random.random() < self.unchanged:
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
    appeared, disappeared, displaced = turnover.drawn(random)
    before, after = list(fixed), list(fixed)
    number = 0
    for here, there in [(True, False)] * disappeared + [(False, True)] * appeared + [(True, True)] * displaced:
        thing = labelled(draw(random), number)
        poses = [_free_pose(random, places, thing) for _ in range(here + there)]
        if any(pose is None for pose in poses):
            continue
        found = [moved(thing, pose) for pose in poses if pose is not None]
        before += found[0] if here else ()
        after += found[-1] if there else ()
        number += 1
    for _ in range(staying):
        thing = labelled(draw(random), UNLABELLED)
        pose = _free_pose(random, places, thing)
        kept = moved(thing, pose) if pose is not None else ()
        before += kept
        after += kept
    return Pair(before, after)


def _free_pose(random: np.random.Generator, places: Sequence[Place], thing: StandingObject) -> np.ndarray | None:
    for index in random.permutation(len(places)):
        pose = places[index].pose(random, thing)
        if pose is not None:
            return np.asarray(pose)
    return None
