"""Verdicts by hand, of which it is known what they say."""

import numpy as np

from gmmjax.changes.evidence.facts import names_of
from gmmjax.changes.evidence.verdict import Verdict


def verdict(weights, unobserved=None, *, poses=False, bias=(0.0, 0.0), lower=-10.0, upper=10.0):
    """A verdict with these weights for changed and for not observed, by the name of the fact; all others are 0."""
    names = names_of(poses=poses)
    rows = [[own.get(name, 0.0) for name in names * 2] for own in (weights, unobserved or {})]
    ones = np.ones(len(names))
    return Verdict(names, np.array(rows), np.array(bias), 0 * ones, 0 * ones, ones, lower * ones, upper * ones)


def values(*, poses=False, **facts):
    """Facts as measured: 0, or 1 for the counts, but for those that are given."""
    return dict.fromkeys(names_of(poses=poses), 0.0) | {"count": 1.0} | facts
