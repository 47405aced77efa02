import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.errors import InputError
from gmmjax.mixtures import FitSettings, Prior, fit_mixture
from gmmjax.mixtures.mixture import GaussianMixture
from gmmjax.transport import bures_wasserstein, earth_movers_distance, exact_transport
from tests.differences import along, assert_derivatives
from tests.transport.problems import peer_distance


def random_mixture(seed, live=4, slots=6, dimension=3):
    rng = np.random.default_rng(seed)
    alive = np.arange(slots) < live
    factors = rng.normal(size=(slots, dimension, dimension)) + 2 * np.eye(dimension)
    return GaussianMixture.masked(
        weights=jnp.asarray(rng.dirichlet(np.ones(slots))),
        means=jnp.asarray(rng.normal(size=(slots, dimension)) * 5),
        covariances=jnp.asarray(factors @ np.swapaxes(factors, 1, 2)),
        live=jnp.asarray(alive),
    )


def test_is_the_thesis_distance_between_means_of_live_components():
    with jax.enable_x64(True):
        before, after = random_mixture(0), random_mixture(1, live=6)
        solved = earth_movers_distance(before, after)
    cost = np.linalg.norm(np.asarray(before.means)[:4, None] - np.asarray(after.means)[None], axis=-1)
    assert float(solved.cost) == pytest.approx(
        peer_distance(np.asarray(before.weights)[:4], np.asarray(after.weights), cost), rel=1e-9
    )
    assert np.all(np.asarray(solved.plan)[4:] == 0)


def test_bures_wasserstein_sees_a_change_of_shape_alone():
    with jax.enable_x64(True):
        before = random_mixture(2)
        after = GaussianMixture.masked(before.weights, before.means, 4 * before.covariances, before.live)
        assert float(earth_movers_distance(before, after).cost) == pytest.approx(0, abs=1e-12)
        cost = bures_wasserstein(before.means, before.covariances, after.means, after.covariances)
        expected = exact_transport(before.weights, after.weights, cost).cost
        found = earth_movers_distance(before, after, ground_cost="bures_wasserstein").cost
    assert float(found) > 0.1
    assert float(found) == pytest.approx(float(expected), rel=1e-12)


def test_sinkhorn_approaches_exact():
    with jax.enable_x64(True):
        before, after = random_mixture(3), random_mixture(4)
        exact = earth_movers_distance(before, after).cost
        entropic = earth_movers_distance(before, after, solver="sinkhorn", epsilon=0.05).cost
    assert float(entropic) == pytest.approx(float(exact), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("ground_cost", ["euclidean", "bures_wasserstein"])
def test_gradients_under_jit_and_vmap_are_finite_with_dead_slots(ground_cost):
    stack = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(random_mixture(seed) for seed in range(3)))

    def distance(means, before, after):
        moved = GaussianMixture(before.weights, means, before.covariances, before.live)
        return earth_movers_distance(moved, after, ground_cost=ground_cost).cost

    gradients = jax.jit(jax.vmap(jax.grad(distance)))(stack.means, stack, stack)
    assert np.all(np.isfinite(gradients))


@pytest.mark.parametrize(("solver", "ground_cost"), [("exact", "euclidean"), ("sinkhorn", "bures_wasserstein")])
def test_numpy_mixtures_keep_their_digits_where_jax_has_single_precision(solver, ground_cost):
    """As far from the origin as survey coordinates are, whatever JAX's setting."""
    with jax.enable_x64(True):
        before, after = (jax.tree.map(np.asarray, random_mixture(seed)) for seed in (9, 10))
        offset = np.array([1e6, -2e6, 3e6])
        far = [jax.tree.map(np.asarray, mixture.rescaled(1.0, offset)) for mixture in (before, after)]
    near = earth_movers_distance(before, after, solver=solver, ground_cost=ground_cost)
    solved = earth_movers_distance(*far, solver=solver, ground_cost=ground_cost)
    assert isinstance(solved.cost, np.ndarray) and solved.cost.dtype == np.float64
    assert float(solved.cost) == pytest.approx(float(near.cost), rel=1e-8)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"solver": "auction"}, "exact, sinkhorn"),
        ({"ground_cost": "manhattan"}, "euclidean, bures_wasserstein"),
        ({"epsilon": 0.1}, "epsilon"),
    ],
)
def test_unusable_settings_name_the_choices(settings, message):
    with pytest.raises(InputError, match=message):
        earth_movers_distance(random_mixture(5), random_mixture(6), **settings)


def test_different_dimensions_are_refused():
    with pytest.raises(InputError, match="dimension 3 and after has dimension 2"):
        earth_movers_distance(random_mixture(7), random_mixture(8, dimension=2))


@pytest.mark.slow
@pytest.mark.usefixtures("float64")
@pytest.mark.parametrize("solver", ["exact", "sinkhorn"])
def test_gradient_through_two_fits_equals_central_differences(solver):
    """By the prior's noise floor and concentration, and by the points; dead slots and unequal numbers among them."""
    rng = np.random.default_rng(5)
    places = np.array([[0, 0], [3, 0], [0, 3], [3.4, 2.6]])
    # Of no equal sizes: where weights agree the plan may be another one.
    before, after = (
        jnp.asarray(np.repeat(places[chosen], counts, axis=0) + rng.normal(0, 0.3, (90, 2)))
        for chosen, counts in (([0, 1, 2], [40, 31, 19]), ([1, 2, 3], [23, 39, 28]))
    )
    settings = FitSettings(polish=True)

    def distance(arguments):
        before, floor, concentration = arguments
        prior = Prior(concentration=concentration, noise_floor=floor, scale=0.3, degrees_of_freedom=4.0)
        keys = jax.random.split(jax.random.key(0))
        fits = [
            fit_mixture(points, key=key, max_components=5, prior=prior, settings=settings)
            for points, key in zip((before, after), keys, strict=True)
        ]
        return earth_movers_distance(fits[0].mixture, fits[1].mixture, solver=solver).cost

    compiled = jax.jit(jax.value_and_grad(distance))
    at = (before, jnp.asarray(0.05), jnp.asarray(-1.5))
    cost, found = compiled(at)
    assert cost > 0.1
    ways = [
        (jnp.asarray(rng.normal(size=before.shape)), jnp.asarray(0.0), jnp.asarray(0.0)),
        (jnp.zeros_like(before), jnp.asarray(1.0), jnp.asarray(0.0)),
        (jnp.zeros_like(before), jnp.asarray(0.0), jnp.asarray(1.0)),
    ]
    for way in ways:
        slope = sum(jax.tree.leaves(jax.tree.map(lambda own, part: (own * part).sum(), found, way)))
        assert_derivatives(slope, along(lambda own: compiled(own)[0], at, way, 1e-4), precision=1e-6)
