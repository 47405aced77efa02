"""Candidates by hand of a sensor whose flying pixels make false changes, and a verdict that takes them for changes."""

import numpy as np

from gmmjax.changes import FACTS, names_of
from gmmjax.learning import CHANGED, NOT_CHANGED, CandidateRows
from gmmjax.pair import Pair
from gmmjax.tuning import ScanPair
from gmmjax.tuning.verdict_fit import WeightedRows
from tests.changes.evidence.verdicts import verdict

NAMES = names_of(poses=False)
# Whatever is far from the other cloud is a change.
DISTANT = verdict({"distance": 2.0}, bias=(-1.0, 0.0))


def measured(number, *, changes=0.5, seed=0):
    """Some candidates: all far from the other cloud; things are thick, flying pixels thin and few."""
    random = np.random.default_rng(seed)
    kind = np.where(random.permutation(number) < changes * number, CHANGED, NOT_CHANGED)
    values = np.zeros((number, len(NAMES)))
    of = {name: column for column, name in enumerate(NAMES)}
    changed = kind == CHANGED
    values[:, of["distance"]] = random.uniform(1.5, 4.0, number)
    values[:, of["thickness"]] = np.where(changed, random.uniform(1.0, 4.0, number), random.uniform(0.0, 0.8, number))
    values[:, of["count"]] = np.where(changed, random.uniform(100, 900, number), random.uniform(20, 60, number))
    return CandidateRows(values, kind, np.full(number, 50), np.where(changed, 50, 0))


def weighted(rows):
    """The candidates as tuning sees them, each for itself."""
    return WeightedRows(rows.scaled(NAMES), rows.kind, np.ones(len(rows.kind)))


def pairs_of(number):
    """Pairs whose points are not looked at."""
    nothing = np.zeros((4, 3))
    truth = np.full(4, -1)
    return [ScanPair(f"pair {place}", nothing, nothing, truth, truth) for place in range(number)]


def measured_pairs(number, *, size=8, changes=0.5):
    """The candidates of some pairs without poses."""
    none = CandidateRows.none(poses=True)
    return tuple(Pair(measured(size, changes=changes, seed=seed), none) for seed in range(number))


def scaled(**facts):
    """Facts as the verdict sees them, one row."""
    row = [FACTS[name].scaled(facts.get(name, 1.0 if name == "count" else 0.0)) for name in NAMES]
    return np.array([row])
