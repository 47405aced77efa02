"""The simulated laboratory and the families of simulated places as labelled pairs, with poses or without."""

import functools
from collections.abc import Mapping, Sequence
from typing import Literal

import jax

from gmmjax.errors import check_choice
from gmmjax.evaluation.labelled_pair import LabelledCloud, LabelledPair, PairSource
from gmmjax.pair import each
from gmmjax.scenes import FAMILIES, Difficulty, SurveyKind, family_scene, laboratory_scene

Poses = Literal["given", "unknown"]
# Objects that appear, disappear and move.
CONDITIONS: Mapping[str, tuple[int, int, int]] = {
    "(+1)": (1, 0, 0),
    "(+2)": (2, 0, 0),
    "(+3)": (3, 0, 0),
    "(-1)": (0, 1, 0),
    "(-2)": (0, 2, 0),
    "(-1 +1)": (1, 1, 0),
    "(-2 +2)": (2, 2, 0),
    "(moved)": (0, 0, 1),
    "(none)": (0, 0, 0),
}


def laboratory_sources(
    seeds: Sequence[int], *, level: Difficulty = "normal", survey: SurveyKind = "panorama", poses: Poses = "given"
) -> list[PairSource]:
    """The scenes of every condition and seed.

    Args:
        seeds: one scene of every condition for each.
        level: "normal" or "hard".
        survey: "panorama" or "frame".
        poses: whether the detectors are given the camera's poses.
    """
    group = f"{level} {survey}, poses {poses}"
    return [
        PairSource(
            f"seed {seed}", group, condition, functools.partial(laboratory_pair, condition, seed, level, survey, poses)
        )
        for condition in CONDITIONS
        for seed in seeds
    ]


def laboratory_pair(condition: str, seed: int, level: Difficulty, survey: SurveyKind, poses: Poses) -> LabelledPair:
    """One scene, drawn from the seed."""
    appeared, disappeared, moved = CONDITIONS[condition]
    scene = laboratory_scene(
        jax.random.key(seed), appeared=appeared, disappeared=disappeared, moved=moved, level=level, survey=survey
    )
    before = LabelledCloud(
        scene.before, scene.truth_before, scene.unseen_before, scene.views_before, scene.uncounted_before
    )
    after = LabelledCloud(scene.after, scene.truth_after, scene.unseen_after, scene.views_after, scene.uncounted_after)
    return _of_poses(LabelledPair(f"seed {seed}", before, after), poses)


def family_sources(names: Sequence[str], seeds: Sequence[int], *, poses: Poses = "given") -> list[PairSource]:
    """The scenes of every family and seed.

    Args:
        names: of the families; each is a condition.
        seeds: one scene of every family for each.
        poses: whether the detectors are given the sensor's poses.

    Raises:
        InputError: no such family.
    """
    for name in names:
        check_choice("family", name, tuple(FAMILIES))
    return [
        PairSource(f"seed {seed}", f"poses {poses}", name, functools.partial(family_pair, name, seed, poses))
        for name in names
        for seed in seeds
    ]


def family_pair(name: str, seed: int, poses: Poses) -> LabelledPair:
    """One scene of a family, drawn from the seed."""
    scene = family_scene(name, seed)
    clouds = each(LabelledCloud, scene.clouds, scene.truth, scene.unseen, scene.views, scene.uncounted)
    return _of_poses(LabelledPair(f"seed {seed}", *clouds), poses)


def _of_poses(pair: LabelledPair, poses: Poses) -> LabelledPair:
    return pair if poses == "given" else pair.without_views()
