import jax
import numpy as np
import ot
import pytest

from gmmjax import GaussianMixture
from gmmjax.changes import remove_extra
from gmmjax.scenes import random_scene
from tests.mixtures.examples import pad


@jax.jit
def removals(reference, mixture):
    return remove_extra(reference, mixture)


def plain_algorithm_1(reference, mixture):
    """Algorithm 1 in NumPy with POT's EMD: the oracle."""

    def emd(kept):
        cost = np.linalg.norm(reference.means[:, None] - mixture.means[kept][None], axis=2)
        weights = mixture.weights[kept]
        return ot.emd2(reference.weights, weights / weights.sum(), cost)

    kept = list(range(len(mixture.weights)))
    lowest, removed = emd(kept), []
    while len(kept) > 1:
        trials = {k: emd([other for other in kept if other != k]) for k in kept}
        best = min(trials, key=trials.get)
        if trials[best] >= lowest - 1e-9:
            break
        lowest = trials[best]
        removed.append(best)
        kept.remove(best)
    return removed, lowest


def random_mixture(random, components):
    covariances = np.tile(0.05 * np.eye(3), (components, 1, 1))
    weights = random.dirichlet(np.full(components, 4.0))
    return GaussianMixture(weights, random.uniform(-3, 3, (components, 3)), covariances, np.ones(components, bool))


@pytest.mark.parametrize("seed", range(20))
def test_equals_the_plain_algorithm(float64, seed):
    random = np.random.default_rng(seed)
    reference = random_mixture(random, random.integers(1, 8))
    mixture = random_mixture(random, random.integers(1, 8))
    removed, lowest = plain_algorithm_1(reference, mixture)
    ours = removals(pad(reference, 8), pad(mixture, 8))
    assert set(np.flatnonzero(ours.removed)) == set(removed)
    np.testing.assert_allclose(ours.emd, lowest, rtol=1e-9)
    assert ours.valid


def test_finds_what_appeared_and_swapped_what_disappeared(float64):
    scene = random_scene(jax.random.key(1), appeared=2, points=1)
    before, after = pad(scene.mixture_before, 8), pad(scene.mixture_after, 8)
    np.testing.assert_array_equal(np.flatnonzero(removals(before, after).removed), [5, 6])
    np.testing.assert_array_equal(np.flatnonzero(removals(after, before).removed), [])
    # Backwards in time what appeared has disappeared (4.5.1).
    np.testing.assert_array_equal(np.flatnonzero(removals(before, after).removed), [5, 6])


def test_equal_mixtures_keep_everything_and_one_gaussian_is_always_left(float64):
    scene = random_scene(jax.random.key(1), appeared=0, points=1)
    mixture = pad(scene.mixture_before, 8)
    same = removals(mixture, mixture)
    assert not same.removed.any() and same.emd == 0
    one = pad(jax.tree.map(lambda leaf: leaf[:1], scene.mixture_before), 8)
    assert removals(one, mixture).removed.sum() <= 4
    assert not removals(mixture, GaussianMixture(*[leaf[:8] for leaf in jax.tree.leaves(one)])).removed.any()


def test_all_pairs_at_once_equal_a_loop(float64):
    random = np.random.default_rng(0)
    references = [pad(random_mixture(random, 5), 8) for _ in range(2)]
    mixtures = [pad(random_mixture(random, 6), 8) for _ in range(3)]
    stack = [jax.tree.map(lambda *leaves: np.stack(leaves), *group) for group in (references, mixtures)]
    batch = jax.vmap(jax.vmap(removals, in_axes=(None, 0)), in_axes=(0, None))(*stack)
    for i, reference in enumerate(references):
        for j, mixture in enumerate(mixtures):
            single = removals(reference, mixture)
            np.testing.assert_array_equal(batch.removed[i, j], single.removed)
            np.testing.assert_allclose(batch.emd[i, j], single.emd, rtol=1e-12)
