"""Candidates by hand, whose truth follows from two facts."""

import numpy as np

from gmmjax.changes import FACTS, names_of
from gmmjax.learning import CandidateRows

NAMES = names_of(poses=False)


def rows(seed, number=200, *, steepness=6.0):
    """Candidates that changed where the mixture says so and nothing is continued, with some chance."""
    random = np.random.default_rng(seed)
    values = random.uniform(0, 1, (number, len(NAMES)))
    values[:, [FACTS[name].scale == "count" for name in NAMES]] += 1
    excess, continued = (values[:, NAMES.index(name)] for name in ("excess", "continued"))
    odds = np.stack([steepness * (excess - 0.5), steepness * (continued - 0.8), np.zeros(number)], axis=1)
    probability = np.exp(odds) / np.exp(odds).sum(axis=1, keepdims=True)
    kind = (random.random(number)[:, None] > probability.cumsum(axis=1)).sum(axis=1)
    points = np.full(number, 10)
    return CandidateRows(values, kind, points, np.where(kind == 0, 10, 0)), probability
