import jax
import numpy as np
import pytest
from sklearn.mixture import GaussianMixture as ScikitMixture

from gmmjax.mixtures import (
    akaike_information_criterion,
    bayesian_information_criterion,
    message_length,
    minimum_description_length,
    parameters_per_component,
)
from gmmjax.mixtures.criteria import criterion_score
from tests.mixtures.examples import cloud, random_mixture


def test_full_covariances_in_space_have_ten_parameters_each():
    """J = 10 K - 1 (thesis 2.2.2)."""
    assert parameters_per_component(3) == 9
    assert random_mixture(components=4, slots=9).number_of_parameters() == 39


@pytest.mark.parametrize(("ours", "theirs"), [("full", "full"), ("diagonal", "diag"), ("spherical", "spherical")])
@pytest.mark.parametrize("dimension", [2, 3, 6])
def test_parameters_are_those_of_scikit_learn(ours, theirs, dimension):
    peer = ScikitMixture(4, covariance_type=theirs, max_iter=200).fit(cloud(dimension))
    assert random_mixture(dimension=dimension).number_of_parameters(ours) == peer._n_parameters()


def test_tied_covariance_is_counted_once():
    peer = ScikitMixture(4, covariance_type="tied", max_iter=200).fit(cloud())
    assert random_mixture().number_of_parameters("tied") == peer._n_parameters()


def test_scores_are_the_equations():
    """In float64, as a mixture of the host is, where JAX's default is float32."""
    mixture, n, log_likelihood = random_mixture(components=4, slots=6), 700.0, -1234.5
    weights = mixture.weights[:4]
    expected = {
        minimum_description_length: 9 / 2 * np.log(n * weights / 12).sum() + 4 / 2 * np.log(n / 12) + 4 * 10 / 2,
        message_length: 9 / 2 * np.log(weights).sum() + 10 / 2 * 4 * np.log(n),
        bayesian_information_criterion: 39 / 2 * np.log(n),
        akaike_information_criterion: 2 * 39,
    }
    for criterion, penalty in expected.items():
        np.testing.assert_allclose(criterion(mixture, log_likelihood, n), 1234.5 + penalty, rtol=1e-13)


def test_bic_is_half_of_scikit_learns(float64):
    points = cloud()
    peer = ScikitMixture(4, max_iter=200, random_state=0).fit(points)
    log_likelihood = peer.score(points) * len(points)
    ours = criterion_score("bic", random_mixture(), log_likelihood, float(len(points)))
    np.testing.assert_allclose(2 * ours, peer.bic(points))


def test_scores_can_be_vmapped(float64):
    mixtures = [random_mixture(seed=seed) for seed in range(3)]
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *mixtures)
    batch = jax.vmap(lambda mixture: message_length(mixture, -10.0, 700.0))(stacked)
    np.testing.assert_allclose(batch, [message_length(mixture, -10.0, 700.0) for mixture in mixtures])
