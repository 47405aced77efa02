"""Many pairs from many restarts: every way of computing them, averages, failures."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import FitStatus, InputError, InputWarning, Prior, averaged, compare, compare_many
from gmmjax.comparison import many_pairs
from gmmjax.mixtures import WeightedPoints, stacked
from tests.comparison.clouds import KEPT, padded, pair

RESTARTS, KEY = 3, jax.random.key(5)
# Without a noise floor, so that flat clouds have no mixture.
PRIOR = Prior.figueiredo_jain(3, 0.0)


@pytest.fixture(scope="module")
def clouds():
    """Pairs of different sizes; the third is flat, and the restarts of its fits fail."""
    pairs = [pair(seed, sizes)[:2] for seed, sizes in ((0, [80] * 7), (1, [60, 70, 65, 90, 55, 75, 50]))]
    flat = [own * [1, 1, 0] for own in pair(2)[:2]]
    return [*pairs, flat]


def batch_of(pairs):
    """All pairs with padding, and their masses."""
    rows = max(len(own) for clouds in pairs for own in clouds) + 7
    return [stacked([padded(clouds[time], rows) for clouds in pairs]) for time in (0, 1)]


def assert_equal(found, expected, sizes=None):
    for name in ("emd", "emd_unchanged", "changed_before", "changed_after", "log_likelihood"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-9, atol=1e-9)
    for name, size in zip(("probability_before", "probability_after"), sizes or (None, None), strict=True):
        np.testing.assert_allclose(getattr(found, name)[:size], getattr(expected, name), atol=1e-9)
    for name in ("fit_before", "fit_after", "transport"):
        assert getattr(found, name) == getattr(expected, name)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["greedy", "transport", "joint"])
def test_mapped_queued_and_looped_comparisons_are_equal(float64, clouds, method):
    compare_few = functools.partial(compare, prior=PRIOR, method=method, max_components=10)
    (befores, masses_before), (afters, masses_after) = batch_of(clouds)
    keys = jax.vmap(lambda key: jax.random.split(key, RESTARTS))(jax.random.split(KEY, len(clouds)))

    def of_restart(before, after, mass_before, mass_after, key):
        return compare_few(before, after, mass_before=mass_before, mass_after=mass_after, key=key)

    over_restarts = jax.vmap(of_restart, in_axes=(None, None, None, None, 0))
    mapped = jax.jit(jax.vmap(over_restarts))(befores, afters, masses_before, masses_after, keys)
    with pytest.warns(InputWarning, match=r"pairs\[2\]: 3 of 3 restarts failed.*noise_floor"):
        many = list(compare_many(clouds, key=KEY, restarts=RESTARTS, prior=PRIOR, method=method, max_components=10))
    queued = {own.pair: own.restarts for own in many}
    assert sorted(queued) == [0, 1, 2]
    for index, own in enumerate(clouds):
        for restart in range(RESTARTS):
            alone = compare_few(*own, key=keys[index, restart], throw=False)
            assert alone.failed == (index == 2)
            assert_equal(jax.tree.map(lambda leaf: leaf[restart], queued[index]), alone)  # noqa: B023
            lane = jax.tree.map(lambda leaf: leaf[index, restart], mapped)  # noqa: B023
            assert_equal(lane, alone, [len(cloud) for cloud in own])


@pytest.mark.slow
def test_side_by_side_as_on_an_accelerator_is_the_same(clouds, monkeypatch):
    arguments = dict(key=KEY, restarts=2, max_components=10)
    pairs = [clouds[0], clouds[1], clouds[0]]
    queued = sorted(compare_many(pairs, **arguments), key=lambda own: own.pair)
    monkeypatch.setattr(many_pairs, "_on_cores", many_pairs._side_by_side)
    monkeypatch.setattr(many_pairs, "SIDE_BY_SIDE", 4)
    mapped = sorted(compare_many(pairs, **arguments), key=lambda own: own.pair)
    for one, other in zip(queued, mapped, strict=True):
        np.testing.assert_allclose(one.mean.probability_after, other.mean.probability_after, atol=1e-9)
        np.testing.assert_allclose(one.mean.emd, other.mean.emd, rtol=1e-9)


@pytest.mark.slow
def test_clouds_with_masses_and_progress(clouds):
    before, after = clouds[0]
    weighted = WeightedPoints(before, np.full(len(before), 2.0))
    doubled = np.concatenate([before, before]), after
    told = []
    one, other = sorted(
        compare_many(
            [(weighted, after), doubled],
            key=jax.random.key(0),
            restarts=2,
            max_components=10,
            progress=lambda *numbers: told.append(numbers),
        ),
        key=lambda own: own.pair,
    )
    assert told == [(1, 2), (2, 2)]
    gone = len(KEPT) * 80
    assert one.mean.probability_before[-40:].min() > 0.5 > one.mean.probability_before[:gone].mean()
    np.testing.assert_allclose(one.mean.emd, other.mean.emd, rtol=0.1)


def test_a_pair_that_cannot_be_compared_is_named_before_any_is_computed(clouds, as_users):
    bad = (clouds[0][0], np.full((50, 3), np.nan))
    with pytest.raises(InputError, match=r"pairs\[1\], after: points has 50 rows"):
        compare_many([clouds[0], bad], key=KEY)
    with pytest.raises(InputError, match=r"pairs\[0\] must be two clouds"):
        compare_many([clouds[0][:1]], key=KEY)
    with pytest.raises(InputError, match="0 pairs"):
        compare_many([], key=KEY)
    with pytest.raises(InputError, match="restarts=0"):
        compare_many(clouds, key=KEY, restarts=0)
    with pytest.raises(InputError, match="host function"):
        jax.jit(lambda before: compare_many([(before, before)], key=KEY))(clouds[0][0])


def test_who_stops_early_stops_the_work(clouds):
    results = compare_many([clouds[0]] * 50, key=KEY, restarts=2, max_components=10)
    assert next(results).pair in (0, 1, 2)
    results.close()


def mapped_restarts(before, after, restarts=6, **arguments):
    keys = jax.random.split(KEY, restarts)
    one = functools.partial(compare, before, after, max_components=10, **arguments)
    return jax.jit(jax.vmap(lambda key: one(key=key)))(keys)


@pytest.mark.slow
def test_the_mean_is_that_of_the_restarts_with_its_standard_error(float64, clouds):
    restarts = mapped_restarts(*clouds[1])
    mean = averaged(restarts)
    values = np.asarray(restarts.probability_after)
    np.testing.assert_allclose(mean.probability_after, values.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(mean.error_after, values.std(axis=0, ddof=1) / np.sqrt(6), atol=1e-9)
    np.testing.assert_allclose(mean.emd, np.mean(restarts.emd), rtol=1e-12)
    assert mean.used == 6 and mean.fits_before.sum() == 6 and mean.transports.tolist() == [6, 0, 0, 0, 0]
    twice = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), restarts)
    np.testing.assert_allclose(jax.vmap(averaged)(twice).emd, [mean.emd, mean.emd], rtol=1e-12)


def lost(comparison, lanes):
    """The comparison, of which some restarts failed."""
    failed = np.isin(np.arange(len(comparison.emd)), lanes)
    numbers = jax.tree.map(
        lambda leaf: (
            jnp.where(failed.reshape(-1, *[1] * (leaf.ndim - 1)), jnp.nan, leaf)
            if jnp.issubdtype(leaf.dtype, jnp.floating)
            else leaf
        ),
        comparison,
    )
    status = jax.vmap(lambda bad, own: FitStatus.where(bad, FitStatus.not_finite, own))(failed, comparison.fit_after)
    return type(comparison)(**{**vars(numbers), "fit_after": status})


def test_failed_restarts_are_left_out_and_said(float64, clouds):
    restarts = mapped_restarts(*clouds[1])
    with pytest.warns(InputWarning, match=r"2 of 6 comparisons failed and are left out.*noise_floor"):
        mean = averaged(lost(restarts, [1, 4]))
    kept = [0, 2, 3, 5]
    np.testing.assert_allclose(mean.probability_before, np.asarray(restarts.probability_before)[kept].mean(axis=0))
    assert mean.used == 4 and mean.fits_after.tolist()[2] == 2
    with pytest.warns(InputWarning, match="6 of 6"):
        none = averaged(lost(restarts, range(6)))
    assert none.used == 0 and np.isnan(none.emd) and np.isnan(none.probability_after).all()
    with pytest.warns(InputWarning, match="5 of 6"):
        alone = averaged(lost(restarts, range(5)))
    assert np.isfinite(alone.probability_after).all() and np.isnan(alone.error_after).all()


def test_a_single_comparison_has_no_mean(clouds):
    with pytest.raises(InputError, match="comparison has 0 leading axes"):
        averaged(compare(*clouds[0], key=KEY, max_components=10))
