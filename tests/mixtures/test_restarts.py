import inspect

import equinox as eqx
import jax
import numpy as np
import pytest

from gmmjax import ComputationError, FitStatus, InputError, fit_mixture
from gmmjax.mixtures import best_fit, fit_restarts

KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def points(scene_points):
    return scene_points


@pytest.fixture(scope="module")
def fits(points):
    return fit_restarts(points, key=KEY, restarts=2)


def test_all_restarts_are_returned_and_the_best_wins(points, fits):
    assert fits.message_length.shape == (2,) and fits.mixture.means.shape == (2, 25, 3)
    assert (fits.result == FitStatus.converged).all()
    one_call = fit_mixture(points, key=KEY, restarts=2)
    assert best_fit(fits).message_length == fits.message_length.min() == one_call.message_length


def test_restarts_that_failed_never_win(fits):
    """However short the message length that they report."""
    lengths = np.array([-1e9, float(fits.message_length[1])])
    status = jax.tree.map(lambda leaf: np.array([int(FitStatus.not_finite._value), leaf[1]]), fits.result)
    failed = eqx.tree_at(lambda fits: (fits.message_length, fits.result), fits, (lengths, status))
    assert best_fit(failed).message_length == lengths[1]
    none = eqx.tree_at(lambda fits: fits.message_length, fits, np.full(2, np.inf))
    with pytest.raises(ComputationError, match="none of 2 restarts"):
        best_fit(none)


def test_progress_is_told_for_every_restart(points):
    told = []
    fit_restarts(points, key=KEY, restarts=2, progress=lambda: told.append(1))
    assert len(told) == 2


@pytest.mark.parametrize(
    ("change", "message"), [(dict(restarts=0), "restarts=0"), (dict(precision="float16"), "precision='float16'")]
)
def test_bad_input_is_named(points, change, message):
    with pytest.raises(InputError, match=message):
        inspect.unwrap(fit_restarts)(points, key=KEY, **change)
