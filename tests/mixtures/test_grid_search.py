import inspect

import jax
import numpy as np
import pytest
from sklearn.mixture import GaussianMixture as ScikitMixture

from gmmjax import InputError, fit_mixture
from gmmjax.mixtures import grid_search
from gmmjax.scenes import fixed_scene

KEY = jax.random.key(0)


# Six is the highest number wherever programs are compiled: they are for so many slots, whatever the numbers.
@pytest.fixture(scope="module")
def points():
    return fixed_scene(KEY, points=200).before


@pytest.fixture(scope="module")
def search(points):
    return grid_search(points, key=KEY, components=range(3, 7), restarts=3)


def test_finds_the_four_diagonal_gaussians(search):
    """Section 4.1.1: the lowest score of the four-Gaussian cloud is MDL's with four diagonal Gaussians."""
    assert search.covariance_type == "diagonal"
    assert search.fit.mixture.count == 4


def test_scores_are_complete_and_their_minimum_wins(search):
    assert set(search.scores) == {"mdl", "bic", "aic"}
    assert search.covariance_types == ("full", "diagonal", "spherical", "tied")
    scores = search.scores["mdl"]
    assert scores.shape == (4, 4) and np.isfinite(scores).all()
    assert scores[search.covariance_types.index("diagonal"), 1] == scores.min()


def test_bic_is_that_of_scikit_learn(points, search):
    peers = [ScikitMixture(4, covariance_type="diag", n_init=3, random_state=0, tol=1e-5, max_iter=100)]
    expected = peers[0].fit(points).bic(points) / 2
    np.testing.assert_allclose(search.scores["bic"][1, 1], expected, atol=0.5)


@pytest.mark.slow
def test_criteria_can_choose_differently(points):
    chosen = grid_search(points, key=KEY, components=[4, 6], covariance_types=["spherical", "full"], criterion="aic")
    assert chosen.covariance_type == "full"
    assert chosen.components == (4, 6)


@pytest.mark.slow
def test_method_grid_of_a_fit_searches_from_one_gaussian_up(points, search):
    """The numbers that the search leaves out are worse."""
    fit = fit_mixture(points, key=KEY, method="grid", max_components=6, restarts=3)
    assert fit.mixture.count == 4
    assert float(fit.message_length) == float(search.fit.message_length)


@pytest.mark.slow
def test_traced_search_equals_the_host_search(points):
    """Under jit and vmap over clouds."""
    grid = dict(components=(4, 6), covariance_types=("full", "diagonal"), restarts=2)

    def search(points):
        return grid_search(points, key=KEY, **grid)

    clouds = [points, points[::-1] + 1.0]
    with jax.enable_x64(True):
        batch = jax.jit(jax.vmap(search))(np.stack(clouds))
    for index, cloud in enumerate(clouds):
        host = search(cloud)
        np.testing.assert_allclose(batch.scores["mdl"][index], host.scores["mdl"], rtol=1e-8)
        assert int(batch.type_index[index]) == int(host.type_index)
        np.testing.assert_allclose(batch.fit.mixture.weights[index], host.fit.mixture.weights, atol=1e-8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(components=[]), "components"),
        (dict(components=[0, 2]), "components"),
        (dict(components=[900]), "900 are more than the points, 800"),
        (dict(covariance_types=["round"]), "round.*spherical"),
        (dict(criterion="best"), "best.*mdl"),
        (dict(restarts=0), "restarts=0"),
    ],
)
def test_bad_input_is_named(points, change, message):
    unchecked = inspect.unwrap(grid_search)  # as users have it, without the tests' type checks
    with pytest.raises(InputError, match=message):
        unchecked(points, key=KEY, **change)
