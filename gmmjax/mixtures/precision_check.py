"""Check of a fit in single precision: its score computed again in double precision."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float

from gmmjax._programs import lru_jit
from gmmjax.mixtures.annihilation import Fit, FitSettings, failed
from gmmjax.mixtures.criteria import message_length
from gmmjax.mixtures.expectation_maximisation import FeatureChunks, expectation
from gmmjax.mixtures.noise import log_uniform_density
from gmmjax.mixtures.weighted_points import WeightedPoints

# Nats by which the message length that a fit saw may be off, or by the second number an observation where that is more.
LARGEST_ERROR, LARGEST_RELATIVE_ERROR = 0.1, 1e-5
# The thinnest component whose quadratic form single precision can tell, as a share of the points' spread: rounding of
# x^2, up to 1e-6, is then a fifteenth of its variance.
THINNEST = 4e-3


def scored_in_double(fits: Fit, points: WeightedPoints, settings: FitSettings) -> tuple[Fit, Bool[np.ndarray, " r"]]:
    """The fits with their scores computed in double precision, and which of them single precision got right.

    Not right are fits whose own message length is off by more than rounding may explain, that have a component thinner
    than `THINNEST`, or that ended in numbers that are not finite.

    Args:
        fits: in the frame of the points, with a leading axis of restarts; NumPy arrays.
        points: the points that were fitted, in their frame, in double precision.
        settings: of the fits.
    """
    with jax.enable_x64(True):
        likelihoods, lengths = (np.asarray(part) for part in _scores(fits, points, settings=settings))
    error = max(LARGEST_ERROR, LARGEST_RELATIVE_ERROR * points.mass.sum())
    right = (np.abs(lengths - fits.message_length) <= error) & (_thinnest(fits) >= THINNEST)
    right &= np.asarray(~failed(fits.result))
    scored = eqx.tree_at(lambda fit: (fit.log_likelihood, fit.message_length), fits, (likelihoods, lengths))
    return scored, right


@lru_jit
def _scores(fits: Fit, points: WeightedPoints, *, settings: FitSettings) -> tuple[JaxArray, JaxArray]:
    chunks, log_noise = FeatureChunks.of(points), log_uniform_density(points)
    observations = jnp.sum(chunks.mass)

    def scores(fit: Fit) -> tuple[JaxArray, JaxArray]:
        # Without a noise component its weight is 0 and it adds nothing.
        weights = fit.mixture.weights * (1 - fit.noise_share)
        mixture = eqx.tree_at(lambda own: own.weights, fit.mixture, weights)
        _, log_likelihood = expectation(mixture, chunks, log_noise)
        return log_likelihood, message_length(mixture, log_likelihood, observations, settings.covariance_type)

    return jax.lax.map(scores, fits)


def _thinnest(fits: Fit) -> Float[np.ndarray, " r"]:
    """The least standard deviation of any live component of each fit; 0 where it is not a number."""
    covariances = np.nan_to_num(np.asarray(fits.mixture.covariances), posinf=0.0)
    variances = np.where(fits.mixture.live[..., None], np.linalg.eigvalsh(covariances), np.inf)
    return np.asarray(np.sqrt(np.maximum(variances.min(axis=(1, 2)), 0)))
