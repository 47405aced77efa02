"""Two surveys of any scene with the truth: what changed, what could not be seen, and what the sensors believed."""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.clouds import SensorViews
from gmmjax.errors import InputError
from gmmjax.geometry import rigid_transform, transformed
from gmmjax.pair import Pair, each
from gmmjax.scenes.ray_casting import UNLABELLED, Solid
from gmmjax.scenes.recording import Recording
from gmmjax.scenes.rigid_motions import small_motion

# A change is counted in a cloud when it has at least this number of points there, less than half of them unseen.
MIN_POINTS = 40


@dataclasses.dataclass(frozen=True, eq=False)
class SurveyedScene:
    """Two surveys of a scene with the truth.

    Attributes:
        clouds: what was recorded [n, 3], in the scene's unit.
        truth: per point -1, or the number of its change; a moved object has the same number in both clouds.
        unseen: per point whether the other survey could not see its place.
        views: where the sensor believed to stand.
        uncounted: changes with fewer than 40 points in the cloud, or half of whose points are unseen.
        kinds: of each change: "appeared", "disappeared" or "moved".
        motions: for each moved object the rigid motion [4, 4] from the before to the after cloud as they are given.
        registration: the rigid motion [4, 4] that brings what did not change from the after to the before cloud.
        unit: length of a metre in the clouds.
    """

    clouds: Pair[Float[np.ndarray, "n 3"]]
    truth: Pair[Int[np.ndarray, " n"]]
    unseen: Pair[Bool[np.ndarray, " n"]]
    views: Pair[SensorViews]
    uncounted: Pair[frozenset[int]]
    kinds: tuple[str, ...]
    motions: dict[int, Float[np.ndarray, "4 4"]]
    registration: Float[np.ndarray, "4 4"]
    unit: float = 1.0


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """Transform from the scene's true coordinates to those of the clouds.

    Attributes:
        misregistration: of the after cloud and its views, in true coordinates; metres.
        placement: rigid motion of both clouds: far from the origin, turned; metres.
        unit: length of a metre in the clouds.
    """

    misregistration: Float[np.ndarray, "4 4"] = dataclasses.field(default_factory=lambda: np.eye(4))
    placement: Float[np.ndarray, "4 4"] = dataclasses.field(default_factory=lambda: np.eye(4))
    unit: float = 1.0

    @classmethod
    def drawn(
        cls,
        random: np.random.Generator,
        *,
        shift: float,
        degrees: float,
        any_way_up: bool = False,
    ) -> "Frame":
        """A random one.

        Args:
            random: of everything.
            shift: largest translation of the misregistration, metres.
            degrees: largest angle of the misregistration, about the origin.
            any_way_up: whether the vertical may point anywhere, as in a scene without gravity.
        """
        misregistration = small_motion(random, random.uniform(0, shift), random.uniform(0, degrees))
        return cls(misregistration, _placement(random, any_way_up), _unit(random))

    @property
    def motions(self) -> Pair[Float[np.ndarray, "4 4"]]:
        """The motion of either cloud from true coordinates to its own, before the unit."""
        return Pair(self.placement, self.placement @ self.misregistration)

    def scaled(self, motion: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
        """A rigid motion in metres, in the clouds' unit."""
        return rigid_transform(motion[:3, :3], self.unit * motion[:3, 3])


def surveyed_scene(
    solids: Pair[Sequence[Solid]],
    recordings: Pair[Recording],
    frame: Frame = Frame(),
    *,
    hidden_by: float = 0.03,
    covers: Pair[Sequence[Solid]] = Pair((), ()),
) -> SurveyedScene:
    """The scene of two recordings.

    Args:
        solids: of the scene at the time of either survey; those with a label are changes, numbered from 0: in one of
            them alone it came or went, in both it moved.
        recordings: of the two surveys.
        frame: how the clouds' coordinates lie to the true ones.
        hidden_by: a place is hidden when something on its ray is nearer by more than this, metres: some deviations of
            the noise.
        covers: those of the labelled solids of either time that are ground: a surface was displaced. What the other
            survey recorded in them, ground at its time, changed with them and is not hidden by them.

    Raises:
        InputError: labels that are not numbered from 0, or a survey that recorded nothing.
    """
    kinds = _kinds(solids)
    if not all(len(recording.points) for recording in recordings):
        raise InputError("recordings: a survey recorded no point; let its sensor look at the solids")
    truth = each(_truth, recordings, covers.swapped)
    hidden = functools.partial(_unseen, hidden_by=hidden_by)
    unseen = each(hidden, recordings, truth, recordings.swapped, solids.swapped, covers.swapped)
    motions = frame.motions
    return SurveyedScene(
        clouds=each(lambda recording, motion: frame.unit * transformed(recording.points, motion), recordings, motions),
        truth=truth,
        unseen=unseen,
        views=each(lambda recording, motion: _views(recording.views, motion, frame), recordings, motions),
        uncounted=each(uncounted, solids, truth, unseen),
        kinds=kinds,
        motions={
            number: frame.scaled(motions.after @ motion @ np.linalg.inv(motions.before))
            for number, motion in _true_motions(solids, kinds).items()
        },
        registration=frame.scaled(motions.before @ np.linalg.inv(motions.after)),
        unit=frame.unit,
    )


def _truth(recording: Recording, covers: Sequence[Solid]) -> Int[np.ndarray, " n"]:
    """The number of the change of each point, of its own or of what covers its place at the other time."""
    truth = recording.labels.copy()
    for cover in covers:
        truth[(truth == UNLABELLED) & cover.contains(recording.places)] = cover.label
    return truth


def _unseen(
    own: Recording,
    truth: Int[np.ndarray, " n"],
    other: Recording,
    solids: Sequence[Solid],
    covers: Sequence[Solid],
    hidden_by: float,
) -> Bool[np.ndarray, " n"]:
    """Mask of the points of a recording that the other survey could not observe."""
    unseen = ~other.saw(own.places, solids, hidden_by)
    covered = np.flatnonzero(unseen & (truth != own.labels))
    if len(covered):
        bare = [solid for solid in solids if not any(solid is cover for cover in covers)]
        unseen[covered] = ~other.saw(own.places[covered], bare, hidden_by)
    return unseen


def uncounted(solids: Sequence[Solid], truth: Int[np.ndarray, " n"], unseen: Bool[np.ndarray, " n"]) -> frozenset[int]:
    """The labels of changes with too few points in the cloud, or most of whose points the other survey cannot see.

    Args:
        solids: of the scene; those with a label are changes.
        truth: per point the label of its change; of what a change of the other time covers, that of the cover.
        unseen: per point whether the other survey could not see its place.
    """
    few = set()
    for number in ({solid.label for solid in solids} | set(truth.tolist())) - {UNLABELLED}:
        own = truth == number
        if own.sum() < MIN_POINTS or unseen[own].mean() >= 0.5:
            few.add(number)
    return frozenset(few)


def _kinds(solids: Pair[Sequence[Solid]]) -> tuple[str, ...]:
    numbers = solids.map(lambda side: {solid.label for solid in side} - {UNLABELLED})
    union = sorted(numbers.before | numbers.after)
    if union != list(range(len(union))):
        raise InputError(f"solids: the labels of changes are {union}; number them from 0 without gaps, -1 for none")
    names = {(True, False): "disappeared", (False, True): "appeared", (True, True): "moved"}
    return tuple(names[number in numbers.before, number in numbers.after] for number in union)


def _true_motions(solids: Pair[Sequence[Solid]], kinds: tuple[str, ...]) -> dict[int, np.ndarray]:
    """True motion of each moved object, by the poses of its first solid."""
    motions = {}
    for number in (number for number, kind in enumerate(kinds) if kind == "moved"):
        poses = [next(solid.pose() for solid in side if solid.label == number) for side in solids]
        motions[number] = poses[1] @ np.linalg.inv(poses[0])
    return motions


def _views(views: SensorViews, motion: np.ndarray, frame: Frame) -> SensorViews:
    moved = motion @ views.poses
    moved[:, :3, 3] *= frame.unit
    return SensorViews(moved, views.field_of_view, frame.unit * views.max_range)


def _placement(random: np.random.Generator, any_way_up: bool) -> np.ndarray:
    """Mostly as it is; now and then turned, y up, or in a national grid."""
    turn = np.eye(3)
    if any_way_up:
        turn = np.linalg.qr(random.standard_normal((3, 3)))[0]
        turn = turn * np.sign(np.linalg.det(turn))
    elif random.random() < 0.15:
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    far = random.choice([0.0, 10.0, 1e3, 1e5], p=[0.4, 0.3, 0.2, 0.1])
    return rigid_transform(turn, far * random.uniform(-1, 1, 3))


def _unit(random: np.random.Generator) -> float:
    """Metres mostly; centimetres, millimetres, feet, or something of the software's own."""
    return float(
        random.choice([1.0, 100.0, 1000.0, 3.2808399, 10 ** random.uniform(-2, 3)], p=[0.6, 0.1, 0.15, 0.05, 0.1])
    )
