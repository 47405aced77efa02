import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.transport import TransportStatus, exact_transport, sinkhorn
from tests.differences import along, assert_derivatives
from tests.transport.problems import random_problems

pytestmark = pytest.mark.usefixtures("float64")


@pytest.mark.parametrize("kind", ["generic", "dead", "unequal"])
def test_falls_to_the_exact_distance_as_epsilon_falls(kind):
    before, after, cost = (array[0] for array in random_problems(1, 8, 8, kind, seed=1))
    exact = float(exact_transport(before, after, cost).cost)
    gaps = []
    for epsilon in (0.3, 0.1, 0.03, 0.01):
        entropic = sinkhorn(before, after, cost, epsilon=epsilon, max_iterations=50_000)
        assert entropic.result == TransportStatus.optimal
        np.testing.assert_allclose(entropic.plan.sum(1) + entropic.unmatched[0], before, atol=1e-5)
        np.testing.assert_allclose(entropic.plan.sum(0) + entropic.unmatched[1], after, atol=1e-5)
        gaps.append(float(entropic.cost) / exact - 1)
    assert all(later < earlier for earlier, later in itertools.pairwise(gaps))
    assert abs(gaps[-1]) < 1e-3


@pytest.fixture
def promotions():
    """ott-jax differentiates its loop with promotions that the other tests forbid."""
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        yield


@pytest.mark.slow
@pytest.mark.usefixtures("promotions")
def test_padding_changes_neither_the_default_epsilon_nor_the_gradients_in_single_precision():
    problem = random_problems(1, 3, 5, "unequal", seed=2).as_type(np.float32)
    before, after, cost = (jnp.asarray(array[0]) for array in problem)
    padded = jnp.pad(before, (0, 2)), jnp.pad(after, (0, 1)), jnp.pad(cost, ((0, 2), (0, 1)), constant_values=1e9)

    def distance(*problem):
        return sinkhorn(*problem).cost

    gradient = jax.jit(jax.value_and_grad(distance, argnums=(0, 1, 2)))
    (bare_cost, bare), (padded_cost, gradients) = gradient(before, after, cost), gradient(*padded)
    tolerance = 5e-4
    assert padded_cost == pytest.approx(float(bare_cost), rel=tolerance)
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)
    np.testing.assert_allclose(gradients[2][:3, :5], bare[2], atol=tolerance)
    np.testing.assert_allclose(gradients[0][:3], bare[0], atol=tolerance)


@pytest.mark.slow
@pytest.mark.usefixtures("promotions")
def test_gradients_equal_central_differences_under_vmap():
    problems = tuple(map(jnp.asarray, random_problems(3, 3, 5, "unequal", seed=3)))

    @jax.jit
    def distances(*stack):
        return jax.vmap(lambda *problem: sinkhorn(*problem, epsilon=0.2).cost)(*stack)

    gradients = jax.jit(jax.grad(lambda *stack: distances(*stack).sum(), argnums=(0, 1, 2)))(*problems)
    rng = np.random.default_rng(4)
    ways = tuple(rng.normal(size=array.shape) for array in problems)
    found = sum((gradient * way).sum() for gradient, way in zip(gradients, ways, strict=True))
    expected = along(lambda moved: distances(*moved).sum(), problems, ways, 1e-4)
    assert_derivatives(found, expected)


def test_too_few_iterations_are_a_status():
    before, after, cost = (array[0] for array in random_problems(1, 8, 8, "generic", seed=5))
    assert sinkhorn(before, after, cost, epsilon=1e-3, max_iterations=10).result == TransportStatus.not_converged


def test_bad_numbers_and_missing_mass_are_statuses():
    nothing, something, cost = np.zeros(2), np.ones(2), np.ones((2, 2))
    assert sinkhorn(nothing, something, cost).result == TransportStatus.no_mass
    solved = sinkhorn(something, something, cost * np.nan)
    assert solved.result == TransportStatus.invalid_input
    assert not np.any(np.isnan(solved.plan))
