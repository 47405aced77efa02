import numpy as np
import pytest

from gmmjax.changes.objects.volumetric_changes import restart_weights


def test_restarts_on_the_same_points_are_weighted_by_their_posterior_odds():
    weights = restart_weights(np.array([100.0, 100.0, 101.0, 500.0]), comparable=True)
    assert weights.sum() == pytest.approx(1)
    assert weights[0] == weights[1] and weights[2] / weights[0] == pytest.approx(np.exp(-1))
    assert weights[3] < 1e-100


def test_restarts_on_other_samples_count_alike():
    weights = restart_weights(np.array([1.0, 9.0, 5.0, 7.0]), comparable=False)
    np.testing.assert_array_equal(weights, np.full(4, 0.25))
