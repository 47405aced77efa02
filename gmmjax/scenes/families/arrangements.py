"""What stands in a scene before and after a change: things that stay, come, go or are moved by a given motion."""

import dataclasses
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from gmmjax.pair import Pair
from gmmjax.scenes.families.staging import Support
from gmmjax.scenes.families.things import Coordinates, labelled, moved
from gmmjax.scenes.objects import StandingObject
from gmmjax.scenes.ray_casting import Solid


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

    def goes(self, thing: StandingObject) -> None:
        """This is there before only."""
        self.solids.before.extend(labelled(thing, self.changes))
        self.changes += 1

    def comes(self, thing: StandingObject) -> None:
        """This is there after only."""
        self.solids.after.extend(labelled(thing, self.changes))
        self.changes += 1

    def moves(self, thing: StandingObject, motion: Float[np.ndarray, "4 4"]) -> None:
        """This is there before, and after where the motion brings it."""
        before = labelled(thing, self.changes)
        self.solids.before.extend(before)
        self.solids.after.extend(moved(before, motion))
        self.changes += 1


def pose_with_clearance(
    support: Support, random: np.random.Generator, thing: StandingObject, clearance: float
) -> Float[np.ndarray, "4 4"] | None:
    """A free pose about which so much more is free, metres, also of what comes later; None where none was found."""
    pose = dataclasses.replace(support, gap=support.gap + clearance).pose(random, thing)
    if pose is not None:
        spot, radius = support.taken.pop()
        support.taken.append((spot, radius + clearance))
    return pose


def displaced(
    random: np.random.Generator, pose: Float[np.ndarray, "4 4"], shift: tuple[float, float], most_yaw: float
) -> Float[np.ndarray, "4 4"]:
    """A motion along the floor, and about the vertical, of a thing in its place.

    Args:
        random: of length, direction and angle.
        pose: of the thing.
        shift: least and greatest length, metres.
        most_yaw: greatest angle, radians.
    """
    direction, yaw = random.uniform(0, 2 * np.pi), random.uniform(-most_yaw, most_yaw)
    there = pose @ Solid(np.zeros(3), np.ones(3), float(yaw)).pose()
    there[:2, 3] += random.uniform(*shift) * np.array([np.cos(direction), np.sin(direction)])
    return np.asarray(there @ np.linalg.inv(pose))


def cuboid(centre: Coordinates, extent: Coordinates, yaw: float = 0.0) -> Solid:
    """A box by its centre and its edge lengths, metres."""
    return Solid(np.array(centre, float), np.array(extent, float), yaw)


def chance(random: np.random.Generator, probability: float) -> bool:
    """Whether something of this probability happens."""
    return bool(random.random() < probability)
