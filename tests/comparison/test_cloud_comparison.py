"""`compare`: what it finds, that it is the sum of its parts, and its failures."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import (
    ComputationError,
    FitStatus,
    InputError,
    Prior,
    TransportStatus,
    compare,
    earth_movers_distance,
    fit_mixture,
)
from gmmjax.comparison import FIT_SETTINGS, joint_prior, remove_changed, unmatched_shares
from tests.comparison.clouds import padded, pair

METHODS = ("greedy", "transport", "joint")
KEY = jax.random.key(0)
compare_few = functools.partial(compare, max_components=10)


@functools.cache
def compared(method="greedy", **arguments):
    """The comparison of the first pair of clouds."""
    before, after, _, _ = pair()
    return compare_few(before, after, key=KEY, method=method, **arguments)


@pytest.mark.parametrize("method", METHODS)
def test_what_is_gone_and_what_is_new_are_found(method):
    _, _, gone, new = pair()
    found = compared(method)
    np.testing.assert_array_equal(found.probability_before > 0.5, gone)
    np.testing.assert_array_equal(found.probability_after > 0.5, new)
    assert found.disappeared.sum() == found.appeared.sum() == 1
    assert found.emd_unchanged < 0.2 * found.emd
    assert found.fit_before == found.fit_after == FitStatus.converged and found.transport == TransportStatus.optimal
    assert not found.failed and found.probability_before.dtype == np.float64
    np.testing.assert_allclose(found.plan.sum(axis=1), found.mixture_before.weights, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kinds", ["appeared", "disappeared"])
def test_only_what_is_looked_for_is_found(method, kinds):
    found = compared(method, kinds=kinds)
    wanted = kinds == "disappeared", kinds == "appeared"
    assert (found.disappeared.any(), found.appeared.any()) == wanted
    assert ((found.probability_before > 0.5).any(), (found.probability_after > 0.5).any()) == wanted


@pytest.mark.slow
def test_it_is_the_sum_of_its_parts():
    before, after, _, _ = pair(3)
    found = compare_few(before, after, key=KEY)
    fits = [fit_mixture(own, key=KEY, max_components=10, settings=FIT_SETTINGS["greedy"]) for own in (before, after)]
    mixtures = [fit.mixture for fit in fits]
    removed = remove_changed(*mixtures)
    np.testing.assert_array_equal(found.disappeared, removed.disappeared)
    np.testing.assert_array_equal(found.appeared, removed.appeared)
    np.testing.assert_allclose(found.emd, earth_movers_distance(*mixtures).cost, rtol=1e-9)
    np.testing.assert_allclose(found.emd_unchanged, removed.emd, rtol=1e-9)
    expected = mixtures[1].responsibilities(after) @ removed.appeared
    np.testing.assert_allclose(found.probability_after, expected, atol=1e-9)
    np.testing.assert_allclose(found.log_likelihood, sum(fit.log_likelihood for fit in fits), rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_unit_and_place_change_nothing_but_the_unit_of_the_distance(method):
    before, after, _, _ = pair()
    own = compared(method)
    other = compare_few(1000 * before + 5e6, 1000 * after + 5e6, key=KEY, method=method)
    np.testing.assert_allclose(other.probability_after, own.probability_after, atol=1e-4)
    np.testing.assert_allclose(other.emd, 1000 * own.emd, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_clouds_of_any_dimension(method):
    before, after, gone, new = pair()
    deeper = [np.c_[own, np.random.default_rng(0).normal(size=(len(own), 2))] for own in (before, after)]
    for clouds in ([own[:, :2] for own in (before, after)], deeper):
        found = compare_few(*clouds, key=KEY, method=method)
        # Seen from above, some lie over each other.
        assert np.mean((found.probability_before > 0.5) == gone) > 0.8
        assert np.mean((found.probability_after > 0.5) == new) > 0.8


@pytest.mark.parametrize("method", METHODS)
def test_equal_clouds_have_no_change(method):
    before, _, _, _ = pair()
    found = compare_few(before, before, key=KEY, method=method)
    assert not found.disappeared.any() and not found.appeared.any()
    assert found.emd < 1e-9 and found.probability_before.max() < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_padding_is_no_point(float64, method):
    before, after, _, _ = pair()
    (rows, mass), (other_rows, other_mass) = padded(before, 700), padded(after, 701)
    found = compared(method)
    masked = jax.jit(functools.partial(compare_few, key=KEY, method=method))(
        rows, other_rows, mass_before=mass, mass_after=other_mass
    )
    np.testing.assert_allclose(masked.probability_before[: len(before)], found.probability_before, atol=1e-9)
    assert not masked.probability_before[len(before) :].any() and not masked.probability_after[len(after) :].any()
    np.testing.assert_allclose(masked.emd, found.emd, rtol=1e-9)


@pytest.mark.slow
def test_a_trace_in_single_precision_stays_there():
    before, after, gone, _ = pair()
    single = [jnp.asarray(own, jnp.float32) for own in (before, after)]
    found = jax.jit(functools.partial(compare_few, key=KEY))(*single)
    assert {str(leaf.dtype) for leaf in jax.tree.leaves(found)} == {"float32", "bool", "int32"}
    np.testing.assert_array_equal(found.probability_before > 0.5, gone)


def test_at_a_low_temperature_algorithm_1_decides_as_without():
    hard = compared()
    soft = compared(temperature=0.005)
    np.testing.assert_allclose(soft.probability_after, hard.probability_after, atol=0.02)
    warm = compared(temperature=0.3)
    assert 1e-3 < np.abs(warm.changed_after - hard.changed_after).max() < 0.5
    np.testing.assert_array_equal(warm.appeared, hard.appeared)
    assert not warm.changed_after[~warm.mixture_after.live].any()


def test_at_a_low_temperature_transport_leaves_as_much_unmatched_as_without():
    before, after, _, _ = pair()
    soft = compared("transport", temperature=0.005)
    numbers = float(len(before)), float(len(after))
    exact = unmatched_shares(soft.mixture_before, soft.mixture_after, *numbers)
    np.testing.assert_allclose(soft.changed_before, exact.share_before, atol=0.02)
    np.testing.assert_allclose(soft.changed_after, exact.share_after, atol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_sinkhorn_is_near_the_exact_distance(method):
    _, _, _, new = pair()
    exact, entropic = compared(method), compared(method, solver="sinkhorn", epsilon=0.1)
    np.testing.assert_allclose(entropic.emd, exact.emd, rtol=0.05)
    np.testing.assert_array_equal(entropic.probability_after > 0.5, new)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"before": np.zeros((50, 3))}, "before: all points are equal"),
        ({"after": np.full((50, 3), np.nan)}, "after: points has 50 rows with NaN"),
        ({"after": np.zeros((50, 2)) + np.arange(50)[:, None]}, "before has 3 columns and after has 2"),
        ({"before": np.zeros(50)}, r"before: points must have the shape \[n, d\]"),
        ({"mass_before": np.zeros(645)}, "before: points has 0 observations"),
        ({"mass_after": -np.ones(666)}, "after: mass must be finite and not negative"),
        ({"mass_before": np.ones(3)}, "before: mass must have one value a point"),
        ({"max_components": 646}, "max_components=646"),
        ({"max_components": 0}, "max_components=0"),
        ({"method": "best"}, "method='best'.*greedy"),
        ({"solver": "simplex"}, "solver='simplex'"),
        ({"kinds": "moved"}, "kinds='moved'"),
        ({"ground_cost": "manhattan"}, "ground_cost='manhattan'"),
        ({"penalty": 0.1}, 'penalty is of use to method="transport" only'),
        ({"epsilon": 0.1}, 'epsilon is of use to solver="sinkhorn" only'),
        ({"temperature": 0.1, "method": "joint"}, "temperature is of use to the other methods only"),
        ({"temperature": -1.0}, "temperature=-1 must be a positive number"),
        ({"prior": Prior.figueiredo_jain(3, -1.0)}, "prior.noise_floor=-1"),
    ],
)
def test_what_cannot_be_compared_is_named(as_users, arguments, message):
    before, after, _, _ = pair()
    given = {"before": before, "after": after, "key": KEY, "max_components": 10, **arguments}
    with pytest.raises(InputError, match=message):
        compare(**given)


def test_traced_shapes_are_checked(as_users):
    before, after, _, _ = pair()
    with pytest.raises(InputError, match="before has 3 columns and after has 2"):
        jax.jit(functools.partial(compare_few, key=KEY))(before, after[:, :2])
    with pytest.raises(InputError, match="max_components is traced"):
        jax.jit(lambda most: compare(before, after, key=KEY, max_components=most))(5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "solver", "names"),
    [
        ("greedy", "exact", ("temperature",)),
        ("transport", "exact", ("temperature", "penalty")),
        ("joint", "sinkhorn", ("epsilon",)),
    ],
)
def test_numbers_out_of_their_range_are_a_status_under_a_trace(method, solver, names):
    before, after, _, _ = pair()
    one = functools.partial(compare_few, before, after, key=KEY, method=method, solver=solver)
    # In the first lane all are as they should be, in each other one is not.
    lanes = np.full((1 + 3 * len(names), len(names)), 0.3)
    for place in range(len(names)):
        lanes[1 + 3 * place : 4 + 3 * place, place] = -0.3, 0.0, np.nan
    found = jax.jit(jax.vmap(lambda own: one(**dict(zip(names, own, strict=True)))))(jnp.asarray(lanes))
    wrong = np.arange(len(lanes)) > 0
    np.testing.assert_array_equal(found.failed, wrong)
    np.testing.assert_array_equal(found.transport == TransportStatus.invalid_input, wrong)
    assert np.isnan(found.probability_after[1:]).all() and np.isfinite(found.probability_after[0]).all()


# A plane without a noise floor: the likelihood has no maximum.
FLAT = Prior.figueiredo_jain(3, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_what_failed_on_the_host_is_an_error_or_a_status(method):
    before, after, _, _ = pair()
    arguments = dict(key=KEY, method=method, prior=FLAT)
    with pytest.raises(ComputationError, match=r"could not be compared.*noise_floor"):
        compare_few(before * [1, 1, 0], after * [1, 1, 0], **arguments)
    lost = compare_few(before * [1, 1, 0], after * [1, 1, 0], **arguments, throw=False)
    assert lost.failed and np.isnan(lost.emd) and np.isnan(lost.probability_before).all()
    assert not lost.disappeared.any() and not lost.appeared.any()


@pytest.mark.parametrize("method", [pytest.param("greedy", marks=pytest.mark.slow), "transport", "joint"])
def test_a_lane_that_failed_is_nan_in_values_and_derivatives(float64, method):
    before, after, _, _ = pair()
    befores = jnp.stack([before, np.where(np.arange(len(before))[:, None] == 3, np.nan, before), before])
    masses = jnp.stack([jnp.ones(len(before)), jnp.ones(len(before)), jnp.zeros(len(before))])
    settings = dataclasses.replace(FIT_SETTINGS[method], polish=True)

    def lane(before, mass, floor):
        prior = joint_prior(floor, 0.0) if method == "joint" else Prior.figueiredo_jain(3, floor)
        found = compare_few(before, after, key=KEY, mass_before=mass, prior=prior, method=method, settings=settings)
        return found.emd + jnp.sum(found.probability_after), found

    gradients = jax.jit(jax.vmap(jax.value_and_grad(lane, argnums=2, has_aux=True), (0, 0, None)))
    (values, found), derivatives = gradients(befores, masses, 0.02)
    np.testing.assert_array_equal(np.isnan(values), [False, True, True])
    np.testing.assert_array_equal(np.isnan(derivatives), [False, True, True])
    np.testing.assert_array_equal(found.fit_before == FitStatus.invalid_input, [False, True, True])
    for leaf in jax.tree.leaves(found):
        if jnp.issubdtype(leaf.dtype, jnp.floating):
            assert np.isnan(leaf[1:]).all() and np.isfinite(leaf[0]).all()
