"""Two surveys of a scene that changed in between, as a labelled pair."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews
from gmmjax.evaluation import LabelledCloud, LabelledPair
from gmmjax.geometry import least_squares_transform
from gmmjax.pair import Pair, each
from tests.benchmarks.held_out.casting import Thing
from tests.benchmarks.held_out.sensors import Sensor

# A change is counted where it has this many points, and less than this share of them out of the other survey's sight.
LEAST_POINTS, MOST_UNSEEN = 40, 0.5


class Stage:
    """What stands there at either time."""

    def __init__(self) -> None:
        self.worlds: Pair[list[Thing]] = Pair([], [])
        self.motions: dict[int, np.ndarray] = {}
        self._changes = 0

    def stays(self, *meshes: np.ndarray) -> None:
        for mesh in meshes:
            thing = Thing(mesh)
            self.worlds.before.append(thing)
            self.worlds.after.append(thing)

    def goes(self, mesh: np.ndarray) -> None:
        self.worlds.before.append(Thing(mesh, self._next()))

    def comes(self, mesh: np.ndarray) -> None:
        self.worlds.after.append(Thing(mesh, self._next()))

    def moves(self, before: np.ndarray, after: np.ndarray) -> None:
        number = self._next()
        self.motions[number] = least_squares_transform(before.reshape(-1, 3), after.reshape(-1, 3))
        self.worlds.before.append(Thing(before, number))
        self.worlds.after.append(Thing(after, number))

    def _next(self) -> int:
        self._changes += 1
        return self._changes - 1


@dataclasses.dataclass(frozen=True, eq=False)
class Rig:
    """A sensor, and where it went.

    Attributes:
        sensor: that is carried.
        poses: sensor to world, where it truly was [v, 4, 4].
        believed: where it believes to have been.
        thinned: one point is kept in each voxel of this edge, metres; 0: all.
    """

    sensor: Sensor
    poses: np.ndarray
    believed: np.ndarray
    thinned: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Staged:
    """A scene before it is surveyed.

    Attributes:
        stage: what stands there.
        rigs: of both surveys.
        misregistration: rigid motion [4, 4] of the after cloud.
        slack: depth below a surface from which on a place is hidden, metres.
    """

    stage: Stage
    rigs: Pair[Rig]
    misregistration: np.ndarray
    slack: float = 0.03


@dataclasses.dataclass(frozen=True, eq=False)
class HeldOutPair(LabelledPair):
    """A labelled pair with the true motions.

    Attributes:
        motions: by the id of each object that moved, its rigid motion [4, 4] in the frame of the before cloud.
    """

    motions: Mapping[int, np.ndarray] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, eq=False)
class _Survey:
    points: np.ndarray
    places: np.ndarray
    change: np.ndarray


def labelled(name: str, staged: Staged, random: np.random.Generator, *, given: bool) -> HeldOutPair:
    """Surveys the scene at both times.

    Args:
        name: of the pair.
        staged: the scene, and how it is surveyed.
        random: of the noise.
        given: whether the pair has the sensors' poses.
    """
    worlds, rigs = staged.stage.worlds, staged.rigs
    surveys = each(lambda rig, world: _surveyed(rig, world, random), rigs, worlds)
    unseen = each(lambda own, rig, world: ~_seen(own, rig, world, staged.slack), surveys, rigs.swapped, worlds.swapped)
    moved = Pair(np.eye(4), staged.misregistration)

    def cloud(own: _Survey, unseen: np.ndarray, rig: Rig, world: list[Thing], motion: np.ndarray) -> LabelledCloud:
        views = SensorViews(motion @ rig.believed, rig.sensor.field_of_view, rig.sensor.max_range)
        return LabelledCloud(
            own.points @ motion[:3, :3].T + motion[:3, 3],
            own.change,
            unseen,
            views if given else None,
            _not_counted(world, own.change, unseen),
        )

    return HeldOutPair(name, *each(cloud, surveys, unseen, rigs, worlds, moved), staged.stage.motions)


def rig_of(
    sensor: Sensor,
    poses: Sequence[np.ndarray],
    random: np.random.Generator,
    *,
    off: tuple[float, float] = (0.0, 0.0),
    thinned: float = 0.0,
) -> Rig:
    """A rig whose poses are each off by themselves.

    Args:
        sensor: that is carried.
        poses: where it was.
        random: of the errors.
        off: standard deviation of the believed poses, metres and degrees.
        thinned: see `Rig`.
    """
    believed = np.stack([shaken(pose, random, *off) for pose in poses])
    return Rig(sensor, np.stack(poses), believed, thinned)


def shaken(pose: np.ndarray, random: np.random.Generator, metres: float, degrees: float) -> np.ndarray:
    """A pose, shifted and turned about where it is by normal errors."""
    result = pose.copy()
    result[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * random.standard_normal(3)).as_matrix() @ pose[:3, :3]
    result[:3, 3] += metres * random.standard_normal(3)
    return result


def motion_about(
    random: np.random.Generator, metres: float, degrees: float, centre: Sequence[float] = (0, 0, 0)
) -> np.ndarray:
    """A motion of this length in a random direction, by this angle about a random axis through the centre."""
    shift, axis = random.standard_normal((2, 3))
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    middle = np.asarray(centre, float)
    motion[:3, 3] = middle - motion[:3, :3] @ middle + metres * shift / np.linalg.norm(shift)
    return motion


def _surveyed(rig: Rig, world: Sequence[Thing], random: np.random.Generator) -> _Survey:
    change = np.array([thing.change for thing in world] + [-1])
    points, places, changes = [], [], []
    for pose, believed in zip(rig.poses, rig.believed, strict=True):
        frame = rig.sensor.frame(world, pose, random)
        points.append(frame.measured @ believed[:3, :3].T + believed[:3, 3])
        places.append(frame.places)
        changes.append(change[frame.thing])
    kept = _thin(np.concatenate(points), rig.thinned, random)
    return _Survey(np.concatenate(points)[kept], np.concatenate(places)[kept], np.concatenate(changes)[kept])


def _thin(points: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    """The rows of one point of each voxel, in the order in which they came."""
    if not size:
        return np.arange(len(points))
    order = random.permutation(len(points))
    voxels = np.floor(points[order] / size).astype(np.int64)
    _, first = np.unique(voxels @ np.array([73_856_093, 19_349_663, 83_492_791]), return_index=True)
    return np.sort(order[first])


def _seen(own: _Survey, rig: Rig, world: Sequence[Thing], slack: float) -> np.ndarray:
    """Which places of a survey another one observed; what moved does not hide its own former place."""
    visible = np.zeros(len(own.places), bool)
    both = set(np.unique(own.change[own.change >= 0])) & {thing.change for thing in world}
    for change in (-1, *both):
        others = [thing for thing in world if change < 0 or thing.change != change]
        rows = np.flatnonzero(own.change == change if change in both else ~np.isin(own.change, list(both)))
        for pose in rig.poses:
            left = rows[~visible[rows]]
            if len(left):
                visible[left] = rig.sensor.sees(own.places[left], others, pose, slack)
    return visible


def _not_counted(world: Sequence[Thing], change: np.ndarray, unseen: np.ndarray) -> frozenset[int]:
    numbers = {thing.change for thing in world if thing.change >= 0}
    return frozenset(
        number
        for number in numbers
        if (change == number).sum() < LEAST_POINTS or unseen[change == number].mean() >= MOST_UNSEEN
    )
