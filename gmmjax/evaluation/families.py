"""The families of simulated places as labelled pairs, with the sensor's poses or without them."""

import functools
from collections.abc import Sequence

from gmmjax.errors import check_choice
from gmmjax.evaluation.labelled_pair import LabelledCloud, LabelledPair, PairSource
from gmmjax.evaluation.laboratory import Poses
from gmmjax.pair import each
from gmmjax.scenes import FAMILIES, family_scene


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
    clouds = each(
        lambda points, truth, unseen, views, uncounted: LabelledCloud(
            points, truth, unseen, views if poses == "given" else None, uncounted
        ),
        *(scene.clouds, scene.truth, scene.unseen, scene.views, scene.uncounted),
    )
    return LabelledPair(f"seed {seed}", clouds.before, clouds.after)
