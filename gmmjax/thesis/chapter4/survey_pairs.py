"""Surveys of the thesis's laboratory as labelled pairs: single frames, volumetric maps and localised maps."""

import functools
from collections.abc import Sequence

import numpy as np

from gmmjax.clouds import load_open3d
from gmmjax.errors import check_choice
from gmmjax.evaluation import LabelledCloud, LabelledPair, PairSource
from gmmjax.thesis.laboratory import CLOUD_KINDS, PRESETS, CloudKind, LabCloud, RunName, lab_pair

# Pairs in which objects only appear or only disappear: in run 5 there are none.
ONE_TYPE = [runs for runs in PRESETS["thesis"] if "run5" in runs]


def survey_sources(seeds: Sequence[int], kind: CloudKind) -> list[PairSource]:
    """A pair of runs of figure 3.6 for each seed, in turn: from run 5, without objects, to each other run, and back.

    Args:
        seeds: of the surveys.
        kind: of the clouds.

    Returns:
        Sources whose condition is "appeared" or "disappeared".

    Raises:
        InputError: an unknown kind; volumetric maps where Open3D is not installed.
    """
    check_choice("kind", kind, tuple(CLOUD_KINDS))
    if kind == "volumetric":
        load_open3d("simulating volumetric maps")
    return [_source(seed, kind, ONE_TYPE[seed % len(ONE_TYPE)]) for seed in seeds]


def _source(seed: int, kind: CloudKind, runs: tuple[RunName, RunName]) -> PairSource:
    condition = "appeared" if runs[0] == "run5" else "disappeared"
    name = f"{runs[0]} to {runs[1]}, seed {seed}"
    return PairSource(name, kind, condition, functools.partial(_pair, name, kind, runs, seed))


def _pair(name: str, kind: CloudKind, runs: tuple[RunName, RunName], seed: int) -> LabelledPair:
    pair = lab_pair(kind, runs, seed)
    before = _cloud(pair.before, pair.truth_before, pair.unseen_before, pair.uncounted_before)
    return LabelledPair(name, before, _cloud(pair.after, pair.truth_after, pair.unseen_after, pair.uncounted_after))


def _cloud(cloud: LabCloud, truth: np.ndarray, unseen: np.ndarray, uncounted: frozenset[int]) -> LabelledCloud:
    return LabelledCloud(cloud.points, truth, unseen, cloud.views, uncounted, cloud.things)
