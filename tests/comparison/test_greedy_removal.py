import functools

import jax
import numpy as np
import ot
import pytest

from gmmjax import GaussianMixture
from gmmjax.comparison import remove_changed
from gmmjax.scenes import random_scene
from tests.mixtures.examples import pad


@functools.partial(jax.jit, static_argnums=2)
def removals(before, after, kinds):
    return remove_changed(before, after, kinds)


def plain_algorithm_1(before, after, kinds):
    """Algorithm 1 in NumPy with POT's EMD: the oracle. Returns the removed Gaussians of either side and the EMD."""
    sides = {"both": (0, 1), "disappeared": (0,), "appeared": (1,)}[kinds]
    mixtures = before, after

    def emd(kept):
        means = [mixture.means[own] for mixture, own in zip(mixtures, kept, strict=True)]
        weights = [mixture.weights[own] for mixture, own in zip(mixtures, kept, strict=True)]
        weights = [own / own.sum() for own in weights]
        return ot.emd2(*weights, np.linalg.norm(means[0][:, None] - means[1][None], axis=2))

    kept = [list(range(len(mixture.weights))) for mixture in mixtures]
    lowest = emd(kept)
    while True:
        trials = []
        for side in sides:
            for k in kept[side] if len(kept[side]) > 1 else ():
                without = list(kept)
                without[side] = [other for other in kept[side] if other != k]
                trials.append((emd(without), without))
        best, without = min(trials, key=lambda trial: trial[0], default=(np.inf, None))
        if best >= lowest - 1e-9:
            return [set(range(len(m.weights))) - set(k) for m, k in zip(mixtures, kept, strict=True)], lowest
        lowest, kept = best, without


def random_mixture(random, components):
    covariances = np.tile(0.05 * np.eye(3), (components, 1, 1))
    weights = random.dirichlet(np.full(components, 4.0))
    return GaussianMixture(weights, random.uniform(-3, 3, (components, 3)), covariances, np.ones(components, bool))


@pytest.mark.slow
@pytest.mark.parametrize("kinds", ["appeared", "disappeared", "both"])
@pytest.mark.parametrize("seed", range(10))
def test_equals_the_plain_algorithm(float64, seed, kinds):
    random = np.random.default_rng(seed)
    before, after = (random_mixture(random, random.integers(1, 8)) for _ in range(2))
    (disappeared, appeared), lowest = plain_algorithm_1(before, after, kinds)
    ours = removals(pad(before, 8), pad(after, 8), kinds)
    assert set(np.flatnonzero(ours.disappeared)) == disappeared
    assert set(np.flatnonzero(ours.appeared)) == appeared
    np.testing.assert_allclose(ours.emd, lowest, rtol=1e-9, atol=1e-12)
    assert ours.valid


@pytest.mark.parametrize("kinds", ["appeared", "both"])
def test_finds_what_appeared_and_backwards_what_disappeared(float64, kinds):
    scene = random_scene(jax.random.key(1), appeared=2, points=1)
    before, after = pad(scene.mixture_before, 8), pad(scene.mixture_after, 8)
    forwards = removals(before, after, kinds)
    np.testing.assert_array_equal(np.flatnonzero(forwards.appeared), [5, 6])
    assert not forwards.disappeared.any()
    backwards = removals(after, before, {"appeared": "disappeared"}.get(kinds, kinds))
    np.testing.assert_array_equal(backwards.disappeared, forwards.appeared)
    assert not backwards.appeared.any()
    np.testing.assert_allclose(backwards.emd, forwards.emd, atol=1e-12)


def test_equal_mixtures_keep_everything(float64):
    mixture = pad(random_scene(jax.random.key(1), appeared=0, points=1).mixture_before, 8)
    same = removals(mixture, mixture, "both")
    assert not same.appeared.any() and not same.disappeared.any() and same.emd == 0


def test_one_gaussian_is_left_in_either_mixture(float64):
    """From five against one far away, four can go; the last one stays, however far it is."""
    random = np.random.default_rng(0)
    one, five = random_mixture(random, 1), random_mixture(random, 5)
    far = GaussianMixture(one.weights, one.means + 50, one.covariances, one.live)
    result = removals(pad(far, 8), pad(five, 8), "both")
    assert result.appeared.sum() == 4 and not result.disappeared.any()


def test_all_pairs_at_once_equal_a_loop(float64):
    random = np.random.default_rng(0)
    befores = [pad(random_mixture(random, 5), 8) for _ in range(2)]
    afters = [pad(random_mixture(random, 6), 8) for _ in range(3)]
    stack = [jax.tree.map(lambda *leaves: np.stack(leaves), *group) for group in (befores, afters)]
    over_afters = jax.vmap(lambda before, after: removals(before, after, "both"), in_axes=(None, 0))
    batch = jax.vmap(over_afters, in_axes=(0, None))(*stack)
    for i, before in enumerate(befores):
        for j, after in enumerate(afters):
            single = removals(before, after, "both")
            np.testing.assert_array_equal(batch.appeared[i, j], single.appeared)
            np.testing.assert_array_equal(batch.disappeared[i, j], single.disappeared)
            np.testing.assert_allclose(batch.emd[i, j], single.emd, rtol=1e-12)
