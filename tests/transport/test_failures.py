"""What failed has no derivatives, whichever solver failed and why; the problems beside it keep theirs."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.transport import TransportStatus, exact_transport, partial_transport, sinkhorn
from tests.transport.problems import random_problems

pytestmark = pytest.mark.usefixtures("float64")
SOLVERS = {
    "exact": exact_transport,
    "sinkhorn": sinkhorn,
    "partial": functools.partial(partial_transport, penalty=0.5),
    "exact, cut short": functools.partial(exact_transport, max_pivots=0),
    "sinkhorn, cut short": functools.partial(sinkhorn, epsilon=1e-3, max_iterations=10),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("solver", "failure", "status"),
    [
        *[(name, "NaN in a mass", "invalid_input") for name in ("exact", "sinkhorn", "partial")],
        *[(name, "NaN in a cost", "invalid_input") for name in ("exact", "sinkhorn", "partial")],
        *[(name, "no mass", "no_mass") for name in ("exact", "sinkhorn")],
        ("exact, cut short", "generic", "pivot_limit"),
        ("sinkhorn, cut short", "generic", "not_converged"),
    ],
)
def test_a_lane_that_failed_has_no_derivatives(solver, failure, status):
    before, after, cost = random_problems(2, 3, 5, "unequal", seed=1)
    if failure == "NaN in a mass":
        before[1, 0] = np.nan
    elif failure == "NaN in a cost":
        cost[1, 0, 2] = np.nan
    elif failure == "no mass":
        before[1] = 0
    elif solver == "exact, cut short":
        # One row needs no pivot.
        before[0, 1:], cost[0, 1:] = 0, cost[0, :1]

    def distance(*problem):
        solved = SOLVERS[solver](*problem)
        return solved.cost, solved.result

    problems = tuple(map(jnp.asarray, (before, after, cost)))
    reverse = jax.jit(jax.vmap(jax.value_and_grad(distance, (0, 1, 2), has_aux=True)))
    (values, result), gradients = reverse(*problems)
    _, tangents = jax.jit(lambda *own: jax.jvp(jax.vmap(lambda *one: distance(*one)[0]), own, own))(*problems)
    assert (result == getattr(TransportStatus, status))[1]
    assert not np.isfinite(values[1]) and np.isnan(tangents[1])
    assert all(np.isnan(gradient[1]).all() for gradient in gradients)
    if "cut short" not in solver:
        assert np.isfinite(values[0]) and np.isfinite(tangents[0])
        assert all(np.isfinite(gradient[0]).all() for gradient in gradients)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["exact", "sinkhorn", "partial"])
def test_a_failure_that_is_left_out_of_a_mean_does_no_harm(solver):
    before, after, cost = random_problems(2, 3, 5, "unequal", seed=2)
    before[1] = np.nan

    def mean(scale):
        solved = jax.vmap(SOLVERS[solver])(before, after, cost * scale)
        return jnp.where(solved.result == TransportStatus.optimal, solved.cost, 0).sum()

    alone = jax.grad(lambda scale: SOLVERS[solver](before[0], after[0], cost[0] * scale).cost)(1.0)
    assert float(jax.jit(jax.grad(mean))(1.0)) == pytest.approx(float(alone), rel=1e-9)
