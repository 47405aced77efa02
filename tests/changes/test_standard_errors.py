import numpy as np
import pytest

from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.changes.standard_errors import means_of_changes, means_of_pairs, standard_error, standard_error_of_pairs
from gmmjax.pair import Pair


def by_restart(values):
    return RestartValues(len(values), lambda restart, rows: np.asarray(values)[restart][rows])


def test_the_mean_of_a_change_is_over_its_points_in_both_clouds():
    before, after = [[0.2, 0.4, 0.9], [0.0, 0.8, 0.9]], [[0.6], [0.1]]
    labels = Pair(np.array([0, 1, -1]), np.array([1]))
    means = means_of_changes(Pair(by_restart(before), by_restart(after)), labels, 2)
    np.testing.assert_allclose(means, [[0.2, 0.5], [0.0, 0.45]])


def test_of_equal_restarts_it_is_the_deviation_by_the_root_of_their_number():
    values = np.random.default_rng(0).random((7, 3))
    expected = values.std(axis=0, ddof=1) / np.sqrt(7)
    np.testing.assert_allclose(standard_error(values, np.full(7, 1 / 7)), expected)


def test_a_restart_without_weight_adds_nothing():
    values = np.array([[0.2], [0.4], [0.9]])
    error = standard_error(values, np.array([0.5, 0.5, 0.0]))
    np.testing.assert_allclose(error, np.sqrt(2 * 0.25 * 0.1**2 * 3 / 2))


def test_votes_of_pairs_are_shares_of_the_points_of_a_change():
    # Two restarts of the cloud with two Gaussians each; three of the other cloud. Four points, the last of no change.
    components, labels = by_restart([[0, 0, 1, 1], [1, 1, 1, 0]]), np.array([0, 0, 0, -1])
    voted = np.zeros((3, 2, 2), bool)
    voted[:, 0, 0], voted[1, 1, 1] = True, True
    means = means_of_pairs(components, labels, 2, voted)
    np.testing.assert_allclose(means[..., 0], [[2 / 3, 0], [2 / 3, 1], [2 / 3, 0]])
    assert not means[..., 1].any()


def test_the_error_of_pairs_is_that_of_the_restarts_of_both_clouds():
    """By a simulation: each restart of either cloud has an effect of its own, and so has each pair."""
    random = np.random.default_rng(0)
    means, errors = [], []
    for _ in range(400):
        effects = 0.2 * random.normal(size=(12, 1)) + 0.1 * random.normal(size=(1, 8))
        pairs = 0.5 + effects + 0.05 * random.normal(size=(12, 8))
        means.append(pairs.mean())
        errors.append(standard_error_of_pairs(pairs[..., None], np.ones((12, 8), bool))[0])
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(np.std(means), rel=0.1)


def test_pairs_that_were_not_solved_are_left_out():
    means, solved = np.array([[0.2, 0.4, 9.0], [0.4, 0.6, 9.0]])[..., None], np.ones((2, 3), bool)
    solved[:, 2] = False
    expected = standard_error_of_pairs(means[:, :2], solved[:, :2])
    np.testing.assert_allclose(standard_error_of_pairs(means, solved), expected)
