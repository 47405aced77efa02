"""Simulated scenes of many kinds in which things moved, came and went, and the changes that detection finds in them."""

import itertools
import warnings
from collections.abc import Mapping
from typing import NamedTuple, get_args

import jax
import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes import DetectionConfig, JointDetector, Scan, UnpairedChanges, unpaired_changes
from gmmjax.clouds import SensorViews
from gmmjax.errors import ComputationError, InputError, InputWarning
from gmmjax.pair import Pair, each
from gmmjax.scenes import (
    Difficulty,
    Gravity,
    InPlace,
    RearrangementSettings,
    SurveyedScene,
    SurveyKind,
    family_scene,
    laboratory_scene,
    rearranged_scene,
)

# Translation, metres, and rotation, degrees, of the after cloud before the registration, at most.
MISREGISTRATION = (0.02, 0.5)
# Objects that appear, disappear and move in the laboratories, which have room for five; by turns.
TURNOVERS = ((0, 0, 1), (1, 0, 2), (0, 1, 2), (2, 1, 1), (1, 2, 1), (2, 2, 0))


class SceneSettings(NamedTuple):
    """Settings of the surveys of rearranged places: each draws from these ranges.

    Attributes:
        frames: of each survey, least and greatest: few of them see few sides of a thing, and things in front of others.
        pixels: of all frames of a survey, least and greatest: the density of the points.
        voxel: least and greatest edge of the voxels, metres.
    """

    frames: tuple[int, int] = (2, 24)
    pixels: tuple[int, int] = (35_000, 120_000)
    voxel: tuple[float, float] = (0.008, 0.024)


class MovedScene(NamedTuple):
    """Two surveys of a scene with the true motions.

    Attributes:
        clouds: what was recorded [n, 3].
        truth: per point -1, or the number of its change; a thing that moved has one number in both clouds.
        views: where the sensor stood.
        motions: by number of each thing that moved, the rigid motion [4, 4] from the before to the after cloud.
    """

    clouds: Pair[Float[np.ndarray, "n 3"]]
    truth: Pair[Int[np.ndarray, " n"]]
    views: Pair[SensorViews]
    motions: Mapping[int, Float[np.ndarray, "4 4"]]

    @classmethod
    def of(cls, scene: SurveyedScene) -> "MovedScene":
        """Take the part of a surveyed scene."""
        return cls(scene.clouds, scene.truth, scene.views, scene.motions)


def _rearranged(seed: int, gravity: Gravity, in_place: bool, settings: SceneSettings) -> MovedScene:
    """A place in which three things moved, one came and one went; or in which one moved within its place, too."""
    random = np.random.default_rng([seed, 1])
    frames = int(np.exp(random.uniform(*np.log(settings.frames))))
    across = int(np.sqrt(random.uniform(*settings.pixels) / frames / 0.75))
    drawn = RearrangementSettings(
        frames=frames,
        pixels=(across, int(0.75 * across)),
        voxel=float(random.uniform(*settings.voxel)),
        misregistration=(random.uniform(0, MISREGISTRATION[0]), random.uniform(0, MISREGISTRATION[1])),
    )
    motions = get_args(InPlace)
    motion = motions[seed % len(motions)] if in_place else None
    others = {"moved": 1} if in_place else {"appeared": 1, "disappeared": 1, "moved": 3}
    return MovedScene.of(rearranged_scene(seed, gravity, in_place=motion, settings=drawn, **others))


def _laboratory(seed: int) -> MovedScene:
    """A laboratory, with every seed another survey, level and turnover."""
    kinds = list(itertools.product(get_args(SurveyKind), get_args(Difficulty)))
    survey, level = kinds[seed % len(kinds)]
    appeared, disappeared, moved = TURNOVERS[seed // len(kinds) % len(TURNOVERS)]
    scene = laboratory_scene(
        jax.random.key(seed), appeared=appeared, disappeared=disappeared, moved=moved, level=level, survey=survey
    )
    return MovedScene(
        Pair(scene.before, scene.after),
        Pair(scene.truth_before, scene.truth_after),
        Pair(scene.views_before, scene.views_after),
        scene.motions,
    )


# Kinds of rearranged places, with their gravity and whether a thing moved within its place.
_REARRANGED: Mapping[str, tuple[Gravity, bool]] = {
    "rearranged room": ("floor", False),
    "rearranged module": ("none", False),
    "room, within a place": ("floor", True),
    "module, within a place": ("none", True),
}
# All kinds of scenes; of the families those in which things move.
KINDS_OF_SCENES = (
    *_REARRANGED,
    *("laboratory", "rooms", "tabletop", "station", "small_motions", "doors", "corridors"),
)


def moved_scene(kind: str, seed: int, settings: SceneSettings) -> MovedScene:
    """A scene of one of `KINDS_OF_SCENES`; the families have ranges of their own in place of the settings."""
    if kind in _REARRANGED:
        return _rearranged(seed, *_REARRANGED[kind], settings)
    return _laboratory(seed) if kind == "laboratory" else MovedScene.of(family_scene(kind, seed))


class FoundScene(NamedTuple):
    """A scene and the changes that detection finds in it.

    Attributes:
        scene: the scene.
        changes: before moved objects are looked for.
    """

    scene: MovedScene
    changes: UnpairedChanges

    def truth_of(self, index: int) -> int:
        """The number of the true change that most of the points of a change are of, or -1."""
        members = self.changes.labels.map(lambda own: np.flatnonzero(own == index))
        return self.truth_of_members(members)

    def truth_of_members(self, members: Pair[Int[np.ndarray, " _"]]) -> int:
        """The number of the true change that most of some working points of either cloud are of, or -1.

        Args:
            members: their indices; none in a cloud that does not matter.
        """
        before, after = each(_max_of, self.scene.truth, self.changes.members, members)
        return before.union(after).pop() if len(before | after) == 1 else -1

    def motion(self, number: int) -> Float[np.ndarray, "4 4"]:
        """The true motion in the frame of the before cloud, to which the after cloud was registered."""
        registration = self.changes.pair.registration
        motion = self.scene.motions[number]
        return registration.transform @ motion if registration.applied else motion

    def shape(self, number: int) -> Float[np.ndarray, "n 3"]:
        """All that both surveys saw of a thing that moved, where it stood before."""
        before, after = each(lambda points, truth: points[truth == number], self.scene.clouds, self.scene.truth)
        back = np.linalg.inv(self.scene.motions[number])
        return np.concatenate([before, after @ back[:3, :3].T + back[:3, 3]])


def _max_of(truth: np.ndarray, working: np.ndarray, own: np.ndarray) -> set[int]:
    """The number of the change that most points of some working points are of; nothing where there are none."""
    numbers = truth[np.isin(working, own)] + 1
    return {int(np.bincount(numbers).argmax()) - 1} if len(numbers) else set()


def found_scene(kind: str, seed: int, settings: SceneSettings) -> FoundScene | None:
    """A scene, with the poses known in every second one; None without things that moved, or where detection refuses.

    Args:
        kind: of `KINDS_OF_SCENES`.
        seed: of the scene.
        settings: what the rearranged places are like.
    """
    scene = moved_scene(kind, seed, settings)
    sides = scene.truth.map(lambda truth: bool((truth >= 0).any()))
    if not (sides.before and sides.after):
        return None
    views: Pair[SensorViews | None] = scene.views.map(lambda own: own if seed // 2 % 2 else None)
    scans = each(Scan, scene.clouds, views)
    with warnings.catch_warnings():
        # Doubtful registrations are a part of what is learned.
        warnings.simplefilter("ignore", InputWarning)
        try:
            changes = unpaired_changes(JointDetector(DetectionConfig()), scans)
        except (InputError, ComputationError):
            return None
    return None if changes is None else FoundScene(scene, changes)
