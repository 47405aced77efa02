"""Single precision, and when it is not trusted."""

import jax
import numpy as np
import pytest

from gmmjax import Prior, fit_mixture
from gmmjax.mixtures import fit_restarts, message_length


def plane(thickness, size=1500):
    """Two boards of 2 m, so thick, a metre apart, tilted."""
    random = np.random.default_rng(0)
    points = random.uniform(-1, 1, (size, 3)) * [1, 1, thickness / 2]
    points[size // 2 :, 2] += 1
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    return points @ turn


def length_in_double(fit, points):
    with jax.enable_x64(True):
        likelihood = fit.mixture.log_density(points).sum()
        return float(message_length(fit.mixture, likelihood, float(len(points))))


@pytest.fixture(scope="module")
def blobs():
    random = np.random.default_rng(1)
    return random.normal(size=(900, 3)) * 0.3 + random.integers(0, 2, (900, 1)) * 3.0


@pytest.mark.slow
def test_a_plain_cloud_stays_in_single_precision(blobs):
    fit = fit_mixture(blobs, key=jax.random.key(0), max_components=8, precision="float32")
    assert fit.bits == 32
    assert float(fit.message_length) == pytest.approx(length_in_double(fit, blobs), abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("thickness", [0.005, 0.001])
def test_a_thin_plane_is_fitted_in_double_precision(thickness):
    """A board of 1 mm in 2 m is a three hundredth of the spread or less: x^2 has too few digits for its variance."""
    points, prior = plane(thickness), Prior.figueiredo_jain(3, thickness / 10)
    single, double = (
        fit_mixture(points, key=jax.random.key(0), max_components=8, prior=prior, precision=precision)
        for precision in ("float32", "float64")
    )
    assert single.bits == double.bits == 64
    assert float(single.message_length) == pytest.approx(length_in_double(single, points), abs=1e-3)
    assert float(single.message_length) == pytest.approx(float(double.message_length), abs=1e-6)


def test_bits_are_those_of_each_restart(blobs):
    fits = fit_restarts(blobs, key=jax.random.key(0), max_components=8, restarts=3, precision="float32")
    assert fits.bits.tolist() == [32, 32, 32]


@pytest.mark.slow
def test_traced_fits_have_the_bits_of_their_points(blobs):
    fit = jax.jit(lambda points: fit_mixture(points, key=jax.random.key(0), max_components=8))(blobs.astype(np.float32))
    assert fit.bits == 32
