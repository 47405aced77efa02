"""The simulated laboratory as labelled pairs, with the camera's poses or without them."""

import functools
from collections.abc import Mapping, Sequence
from typing import Literal

import jax

from gmmjax.evaluation.labelled_pair import LabelledCloud, LabelledPair, PairSource
from gmmjax.scenes import Difficulty, SurveyKind, laboratory_scene

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
    given = poses == "given"
    return LabelledPair(
        f"seed {seed}",
        LabelledCloud(
            scene.before,
            scene.truth_before,
            scene.unseen_before,
            scene.views_before if given else None,
            scene.uncounted_before,
        ),
        LabelledCloud(
            scene.after,
            scene.truth_after,
            scene.unseen_after,
            scene.views_after if given else None,
            scene.uncounted_after,
        ),
    )
