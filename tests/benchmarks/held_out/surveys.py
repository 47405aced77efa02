"""Two surveys of a scene that changed in between, as a labelled pair."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews
from gmmjax.evaluation import LabelledCloud, LabelledPair
from gmmjax.geometry import least_squares_transform
from gmmjax.pair import Pair, each
from tests.benchmarks.held_out.casting import RIM, Body, Terrain, Thing
from tests.benchmarks.held_out.sensors import Sensor

# A change is counted where it has this many points, and less than this share of them out of the other survey's sight.
MIN_POINTS, MAX_UNSEEN = 40, 0.5


class Stage:
    """Takes meshes as they come, go, move or stay; where nothing changes, all of them stay.

    Attributes:
        worlds: what is there before and after.
        motions: by the id of each object that moved its rigid motion [4, 4].
    """

    def __init__(self, changed: bool = True) -> None:
        self.worlds: Pair[list[Body]] = Pair([], [])
        self.motions: dict[int, np.ndarray] = {}
        self.changed = changed
        self._changes = 0

    def stays(self, *meshes: np.ndarray) -> None:
        self.both(*map(Thing, meshes))

    def both(self, *bodies: Body) -> None:
        for side in self.worlds:
            side.extend(bodies)

    def goes(self, mesh: np.ndarray) -> None:
        self._one_side(self.worlds.before, mesh)

    def comes(self, mesh: np.ndarray) -> None:
        self._one_side(self.worlds.after, mesh)

    def moves(self, before: np.ndarray, after: np.ndarray) -> None:
        if not self.changed:
            self.stays(before)
            return
        number = self.next_number()
        self.motions[number] = least_squares_transform(before.reshape(-1, 3), after.reshape(-1, 3))
        self.worlds.before.append(Thing(before, number))
        self.worlds.after.append(Thing(after, number))

    def next_number(self) -> int:
        self._changes += 1
        return self._changes - 1

    def _one_side(self, side: list[Body], mesh: np.ndarray) -> None:
        if self.changed:
            side.append(Thing(mesh, self.next_number()))
        else:
            self.stays(mesh)


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

    def cloud(own: _Survey, unseen: np.ndarray, rig: Rig, motion: np.ndarray) -> LabelledCloud:
        views = SensorViews(motion @ rig.believed, rig.sensor.field_of_view, rig.sensor.max_range)
        return LabelledCloud(
            own.points @ motion[:3, :3].T + motion[:3, 3],
            own.change,
            unseen,
            views if given else None,
            _not_counted(own.change, unseen),
        )

    return HeldOutPair(name, *each(cloud, surveys, unseen, rigs, moved), staged.stage.motions)


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


def _surveyed(rig: Rig, world: Sequence[Body], random: np.random.Generator) -> _Survey:
    points, places, changes = [], [], []
    for pose, believed in zip(rig.poses, rig.believed, strict=True):
        frame = rig.sensor.frame(world, pose, random)
        points.append(frame.measured @ believed[:3, :3].T + believed[:3, 3])
        places.append(frame.places)
        changes.append(frame.change)
    kept = _thin(np.concatenate(points), rig.thinned, random)
    return _Survey(*(np.concatenate(own)[kept] for own in (points, places, changes)))


def _thin(points: np.ndarray, size: float, random: np.random.Generator) -> np.ndarray:
    """The rows of one point of each voxel, in the order in which they came."""
    if not size:
        return np.arange(len(points))
    order = random.permutation(len(points))
    voxels = np.floor(points[order] / size).astype(np.int64)
    _, first = np.unique(voxels @ np.array([73_856_093, 19_349_663, 83_492_791]), return_index=True)
    return np.sort(order[first])


def _seen(own: _Survey, rig: Rig, world: Sequence[Body], slack: float) -> np.ndarray:
    """Which places of a survey another one observed; what moved or was displaced does not hide its former place."""
    visible = np.zeros(len(own.places), bool)
    depth = max((max(body.depths.values(), default=0.0) for body in world if isinstance(body, Terrain)), default=0.0)
    both = set(np.unique(own.change[own.change >= 0])) & frozenset().union(*(body.changes for body in world))
    for change in (-1, *both):
        others = [body for body in world if body.changes != {change}]
        rows = np.flatnonzero(own.change == change if change in both else ~np.isin(own.change, list(both)))
        for pose in rig.poses:
            left = rows[~visible[rows]]
            if len(left):
                margin = slack + 2 * depth if change in both else slack
                visible[left] = rig.sensor.sees(own.places[left], others, pose, margin)
    return visible


def _not_counted(change: np.ndarray, unseen: np.ndarray) -> frozenset[int]:
    numbers = np.unique(change[change >= 0])
    few = {int(n) for n in numbers if (change == n).sum() < MIN_POINTS or unseen[change == n].mean() >= MAX_UNSEEN}
    return frozenset(few | {RIM})
