"""Random transport problems, and what other solvers say of them."""

from typing import NamedTuple

import numpy as np
import ot
from scipy.optimize import linprog


class Problems(NamedTuple):
    """A stack of problems: masses [n, k0] and [n, k1], costs [n, k0, k1]."""

    before: np.ndarray
    after: np.ndarray
    cost: np.ndarray

    def as_type(self, dtype):
        return Problems(*(array.astype(dtype) for array in self))


def random_problems(count, k0, k1, kind, seed=0):
    """Problems of one kind; all but "unequal" have equal totals."""
    rng = np.random.default_rng([seed, k0, k1])
    before, after = rng.dirichlet(np.ones(k0), count), rng.dirichlet(np.ones(k1), count)
    left, right = rng.normal(size=(count, k0, 3)), rng.normal(size=(count, k1, 3))
    if kind == "same_support":
        shared = min(k0, k1)
        right[:, :shared] = left[:, :shared]
    cost = np.linalg.norm(left[:, :, None] - right[:, None], axis=-1)
    if kind == "ties":
        cost = rng.integers(0, 4, cost.shape).astype(float)
        before, after = np.full_like(before, 1 / k0), np.full_like(after, 1 / k1)
    if kind == "dead":
        before[:, 1:] *= rng.random((count, k0 - 1)) < 0.5
        after[:, 1:] *= rng.random((count, k1 - 1)) < 0.5
        before, after = (mass / mass.sum(1, keepdims=True) for mass in (before, after))
    if kind == "unequal":
        before *= rng.uniform(0.2, 5, (count, 1))
    return Problems(before, after, cost)


def peer_distance(before, after, cost):
    """POT's earth mover's distance, the surplus going to a component that is reached at no cost."""
    flow = min(before.sum(), after.sum())
    surplus = before.sum() - after.sum()
    if abs(surplus) > 1e-12 * flow:
        before, after = np.append(before, max(-surplus, 0)), np.append(after, max(surplus, 0))
        cost = np.pad(cost, ((0, 1), (0, 1)))
    return ot.emd2(before, after * (before.sum() / after.sum()), cost, numItermax=1_000_000) / flow


def linear_programme(before, after, cost, *, flow=None, penalty=0.0):
    """HiGHS on the inequality form: (2.21) where a flow is given, else partial transport with its penalty."""
    k0, k1 = cost.shape
    sums = np.concatenate([np.kron(np.eye(k0), np.ones(k1)), np.kron(np.ones(k0), np.eye(k1))])
    limits = np.concatenate([before, after])
    total = {} if flow is None else {"A_eq": np.ones((1, k0 * k1)), "b_eq": [flow]}
    solved = linprog(cost.ravel() - 2 * penalty, A_ub=sums, b_ub=limits, method="highs", **total)
    assert solved.status == 0
    return solved.fun + penalty * limits.sum()
