"""Functions that are both of the host and traced: concrete arrays inside `jit`, `shard_map`, constants, NumPy."""

import functools
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import FitSettings, FitStatus, InputError, Prior, earth_movers_distance, fit_mixture
from gmmjax.comparison.greedy_removal import remove_changed
from gmmjax.comparison.unmatched_mass import unmatched_shares
from gmmjax.mixtures import (
    GaussianMixture,
    akaike_information_criterion,
    bayesian_information_criterion,
    best_fit,
    fit_restarts,
    grid_search,
    map_fits,
    message_length,
    minimum_description_length,
)
from gmmjax.transport import distance_of_means, exact_transport, partial_transport, sinkhorn

KEY = jax.random.key(0)
POINTS = np.concatenate([np.random.default_rng(0).normal(at, 0.3, (30, 3)) for at in (0, 3)])
MIXTURE = GaussianMixture(np.array([0.4, 0.6]), POINTS[[0, 30]], np.tile(0.1 * np.eye(3), (2, 1, 1)), np.ones(2, bool))
OTHER = GaussianMixture(np.array([0.5, 0.5]), POINTS[[1, 31]], np.tile(0.2 * np.eye(3), (2, 1, 1)), np.ones(2, bool))
MASSES, COST = np.array([0.4, 0.6]), np.array([[0.1, 2.0], [1.0, 0.2]])


@functools.cache
def fits_outside():
    return fit_restarts(POINTS, key=KEY, max_components=3, restarts=2)


def best_of_all():
    fits = fit_restarts(POINTS, key=KEY, max_components=3, restarts=2)
    return fits, best_fit(fits)


FUNCTIONS = {
    "fit_mixture": lambda: fit_mixture(POINTS, key=KEY, max_components=3),
    "fit_mixture by grid": lambda: fit_mixture(POINTS, key=KEY, max_components=2, method="grid"),
    "fit_restarts and best_fit": best_of_all,
    "best_fit of fits outside": lambda: best_fit(fits_outside()),
    "from a start": lambda: fit_mixture(POINTS, key=KEY, start=MIXTURE, prior=Prior.figueiredo_jain(3, 0.01)),
    "grid_search": lambda: grid_search(POINTS, key=KEY, components=[1, 2], covariance_types=["full"]),
    **{
        f"earth_movers_distance, {solver}": lambda solver=solver: earth_movers_distance(MIXTURE, OTHER, solver=solver)
        for solver in ("exact", "sinkhorn")
    },
    "exact_transport": lambda: exact_transport(MASSES, MASSES[::-1], COST),
    "sinkhorn": lambda: sinkhorn(MASSES, MASSES[::-1], COST),
    "partial_transport": lambda: partial_transport(MASSES, MASSES[::-1], COST, 0.5),
    "remove_changed": lambda: remove_changed(MIXTURE, OTHER),
    "unmatched_shares": lambda: unmatched_shares(MIXTURE, OTHER, 60.0, 60.0),
    **{
        criterion.__name__: lambda criterion=criterion: criterion(MIXTURE, -10.0, 60.0)
        for criterion in (
            message_length,
            minimum_description_length,
            bayesian_information_criterion,
            akaike_information_criterion,
        )
    },
    **{
        name: lambda name=name: getattr(MIXTURE, name)(POINTS)
        for name in ("log_joint", "log_density", "responsibilities", "labels")
    },
    "sample": lambda: MIXTURE.sample(KEY, 4),
    "compacted": lambda: MIXTURE.compacted(2),
    "rescaled": lambda: MIXTURE.rescaled(2.0, np.zeros(3)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FUNCTIONS)
def test_concrete_arrays_inside_jit_give_what_they_give_outside(float64, name):
    expected = FUNCTIONS[name]()
    found = jax.jit(lambda one: jax.tree.map(lambda leaf: leaf * one.astype(leaf.dtype), FUNCTIONS[name]()))(
        jnp.ones((), jnp.int8)
    )
    for own, wanted in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(np.asarray(own, float), np.asarray(wanted, float), rtol=1e-6, atol=1e-9)


def test_a_host_function_inside_jit_says_so():
    with pytest.raises(InputError, match="map_fits is a host function"):
        jax.jit(lambda one: map_fits([POINTS], key=KEY)[0].message_length + one)(1.0)


@pytest.mark.parametrize("function", [remove_changed, lambda *pair: unmatched_shares(*pair, 60.0, 60.0)])
def test_mixtures_of_numpy_give_numpy_in_float64(function):
    for leaf in jax.tree.leaves(function(MIXTURE, OTHER)):
        assert isinstance(leaf, np.ndarray) and leaf.dtype in (np.float64, np.bool_)
    single = [jax.tree.map(jnp.asarray, mixture) for mixture in (MIXTURE, OTHER)]
    assert all(isinstance(leaf, jax.Array) and leaf.dtype != np.float64 for leaf in jax.tree.leaves(function(*single)))


def unchecked(function):
    """As users have it, without the tests' type checks."""
    return inspect.unwrap(function)


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("max_components", lambda number: unchecked(fit_mixture)(POINTS, key=KEY, max_components=number)),
        ("max_components", lambda number: unchecked(fit_restarts)(POINTS, key=KEY, max_components=number)),
        ("restarts", lambda number: unchecked(fit_restarts)(POINTS, key=KEY, restarts=number)),
        ("restarts", lambda number: unchecked(grid_search)(POINTS, key=KEY, restarts=number)),
        ("components", lambda number: unchecked(grid_search)(POINTS, key=KEY, components=[number])),
        ("max_iterations", lambda number: unchecked(sinkhorn)(MASSES, MASSES, COST, max_iterations=number)),
    ],
)
def test_what_sizes_the_program_is_a_constant(name, call):
    with pytest.raises(InputError, match=f"{name} is traced"):
        jax.jit(lambda number: (call(number), 0)[1])(3)


def one_shard(function, *arguments):
    mesh = jax.sharding.Mesh(np.array(jax.devices()[:1]), ("lanes",))
    lanes = jax.sharding.PartitionSpec("lanes")
    sharded = jax.shard_map(jax.vmap(function), mesh=mesh, in_specs=lanes, out_specs=lanes)
    return jax.jit(sharded)(*arguments), jax.jit(jax.vmap(function))(*arguments)


def pipeline(points, key):
    fit = fit_mixture(points, key=key, max_components=3)
    mixtures = fit.mixture, fit.mixture.rescaled(1.1, np.zeros(3))
    distances = [earth_movers_distance(*mixtures, solver=solver) for solver in ("exact", "sinkhorn")]
    return fit, distances, remove_changed(*mixtures)


def polished_gradient(points, key):
    def length(points):
        return fit_mixture(points, key=key, max_components=3, settings=FitSettings(polish=True)).message_length

    return jax.value_and_grad(length)(points)


@pytest.mark.slow
@pytest.mark.parametrize(
    "function",
    [
        pipeline,
        polished_gradient,
        lambda points, key: fit_mixture(points, key=key, max_components=3, settings=FitSettings(step="component-wise")),
        lambda points, key: grid_search(points, key=key, components=[2], covariance_types=["full"]).fit,
    ],
    ids=["pipeline", "gradient", "component-wise", "grid"],
)
def test_shard_map_with_its_checks_equals_vmap(float64, function):
    lanes = jnp.stack([POINTS, POINTS[::-1] + 0.1])
    found, expected = one_shard(function, lanes, jax.random.split(KEY, 2))
    for own, wanted in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(np.asarray(own, float), np.asarray(wanted, float), rtol=1e-6, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("solve", [exact_transport, sinkhorn])
def test_shard_map_differentiates_by_what_all_shards_share(float64, solve):
    """As of many pairs with one prior."""
    lanes, shared = jax.sharding.PartitionSpec("lanes"), jax.sharding.PartitionSpec()
    mesh = jax.sharding.Mesh(np.array(jax.devices()[:1]), ("lanes",))
    masses = jnp.stack([MASSES, MASSES[::-1]])

    def costs(masses, cost):
        return jax.vmap(lambda own: solve(own, own[::-1], cost).cost)(masses)

    sharded = jax.shard_map(costs, mesh=mesh, in_specs=(lanes, shared), out_specs=lanes)
    found, expected = (jax.jit(jax.grad(lambda cost, of=of: of(masses, cost).sum()))(COST) for of in (sharded, costs))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_functions_that_are_not_compiled_by_the_user_are_traced_once(monkeypatch):
    """The second call of each runs the program of the first."""
    from gmmjax.mixtures import restarts

    traced, fit_in_frame = [], restarts.fit_in_frame

    def counted(*arguments):
        traced.append(1)
        return fit_in_frame(*arguments)

    def counted_cost(before, after):
        traced.append(1)
        return distance_of_means(before, after)

    monkeypatch.setattr(restarts, "fit_in_frame", counted)
    points, settings = jnp.asarray(POINTS), FitSettings(polish=True, max_polish_steps=4999)

    def length(points):
        return fit_mixture(points, key=KEY, max_components=3, settings=settings).message_length

    calls = {
        "gradient": lambda scale: jax.grad(length)(scale * points),
        "vmap": lambda scale: jax.vmap(length)(scale * points[None]),
        "removal": lambda scale: remove_changed(MIXTURE.rescaled(scale, np.zeros(3)), OTHER, "both", counted_cost),
    }
    for call in calls.values():
        call(1.0)
        before = len(traced)
        assert before
        call(1.01)
        assert len(traced) == before


@pytest.mark.slow
@pytest.mark.parametrize("polish", [True, False])
def test_input_that_is_none_is_a_status_with_no_numbers(float64, polish):
    """Of each lane alone, also in derivatives, in either mode; the first lane is as it should be."""
    settings = FitSettings(polish=polish)
    given = {"points": POINTS, "mass": np.ones(60), "noise_floor": np.array(0.01), "means": MIXTURE.means}
    wrong = [("points", np.nan), ("mass", np.inf), ("mass", -1.0), ("noise_floor", -0.1), ("means", np.nan)]
    lanes = {name: np.stack([own] * (2 + len(wrong))) for name, own in given.items()}
    for lane, (name, value) in enumerate(wrong, start=1):
        lanes[name][(lane,) + (0,) * (lanes[name].ndim - 1)] = value
    lanes["mass"][-1] = 0

    def fit(lane):
        start = GaussianMixture(MIXTURE.weights, lane["means"], MIXTURE.covariances, MIXTURE.live)
        prior = Prior.figueiredo_jain(3, lane["noise_floor"])
        own = fit_mixture(lane["points"], key=KEY, mass=lane["mass"], prior=prior, start=start, settings=settings)
        # Weights, too: every leaf has to be NaN.
        return own.message_length + own.log_likelihood + own.mixture.means.sum(), own.result

    if not polish:
        values, result = jax.jit(jax.vmap(fit))(lanes)
    else:
        (values, result), gradients = jax.jit(jax.vmap(jax.value_and_grad(fit, has_aux=True)))(lanes)
        for leaf in gradients.values():
            assert np.isnan(leaf[1:]).all() and np.isfinite(leaf[0]).all()
    np.testing.assert_array_equal(result == FitStatus.invalid_input, np.arange(len(values)) > 0)
    assert np.isfinite(values[0]) and np.isnan(values[1:]).all()
