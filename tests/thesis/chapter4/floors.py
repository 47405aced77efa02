"""A small survey for the tests: a floor, and a box on it."""

import dataclasses
import functools

import numpy as np

from gmmjax.evaluation import LabelledPair, PairSource
from tests.evaluation.scenes import box_pair


def floor_pair(seed, condition="appeared"):
    """The box appears or disappears; it is thing 1, the floor is thing 0."""
    pair = box_pair(seed, f"seed {seed}")
    before, after = (
        dataclasses.replace(cloud, things=np.where(cloud.truth >= 0, 1, 0)) for cloud in (pair.before, pair.after)
    )
    return LabelledPair(pair.name, *((before, after) if condition == "appeared" else (after, before)))


def floor_sources(seeds, kind):
    """In place of the surveys of the laboratory."""
    conditions = {seed: ("appeared", "disappeared")[seed % 2] for seed in seeds}
    return [
        PairSource(f"seed {seed}", kind, condition, functools.partial(floor_pair, seed, condition))
        for seed, condition in conditions.items()
    ]
