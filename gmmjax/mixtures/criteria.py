"""Information criteria of a mixture: log likelihood against size (thesis 2.2.2), in nats; the lowest wins."""

import math
from typing import Literal, get_args

import jax.numpy as jnp
from jaxtyping import Float

from gmmjax._host import float64_on_host
from gmmjax._typing import Array, Scalar
from gmmjax.mixtures.covariance_type import CovarianceType, parameters_per_component, shared_parameters
from gmmjax.mixtures.mixture import GaussianMixture

Criterion = Literal["mdl", "bic", "aic"]
CRITERIA: tuple[Criterion, ...] = get_args(Criterion)


@float64_on_host
def message_length(
    mixture: GaussianMixture,
    log_likelihood: Scalar,
    observations: Scalar,
    covariance_type: CovarianceType = "full",
    own_parameters: int = 0,
) -> Float[Array, ""]:
    r"""Message length of FJ02: $-\log L + T/2 \sum_k \log w_k + (T + 1)/2 \, K \log n$.

    Their equation (15) without its constants $K (T + 1)/2 \, (1 - \log 12)$, as in the authors' own program;
    `minimum_description_length` keeps them.

    Args:
        mixture: the mixture; K of its slots are live.
        log_likelihood: log likelihood of the observations (nats).
        observations: n, the total mass of the points.
        covariance_type: gives T, the parameters per component.
        own_parameters: what a component has beside mean and covariance, which adds to T.
    """
    parameters = parameters_per_component(mixture.dimension, covariance_type) + own_parameters
    shared = shared_parameters(mixture.dimension, covariance_type)
    log_weights = jnp.sum(jnp.log(jnp.where(mixture.live, mixture.weights, 1)))
    size = ((parameters + 1) * mixture.count + shared).astype(log_weights.dtype) / 2
    return -log_likelihood + parameters / 2 * log_weights + size * jnp.log(observations)


@float64_on_host
def minimum_description_length(
    mixture: GaussianMixture,
    log_likelihood: Scalar,
    observations: Scalar,
    covariance_type: CovarianceType = "full",
) -> Float[Array, ""]:
    r"""MDL with the penalty (2.13): $T/2 \sum_k \log(n w_k / 12) + K/2 \log(n / 12) + K (T + 1)/2$.

    Equation (15) of FJ02 with its constants. Arguments as in `message_length`.
    """
    parameters = parameters_per_component(mixture.dimension, covariance_type)
    shared = shared_parameters(mixture.dimension, covariance_type)
    length = message_length(mixture, log_likelihood, observations, covariance_type)
    size = ((parameters + 1) * mixture.count + shared).astype(length.dtype) / 2
    return length + size * (1 - math.log(12))


@float64_on_host
def bayesian_information_criterion(
    mixture: GaussianMixture,
    log_likelihood: Scalar,
    observations: Scalar,
    covariance_type: CovarianceType = "full",
) -> Float[Array, ""]:
    r"""BIC, equation (2.14): $-\log L + J/2 \log n$. Arguments as in `message_length`."""
    free = mixture.number_of_parameters(covariance_type).astype(mixture.weights.dtype)
    return -log_likelihood + free / 2 * jnp.log(observations)


@float64_on_host
def akaike_information_criterion(
    mixture: GaussianMixture,
    log_likelihood: Scalar,
    observations: Scalar,
    covariance_type: CovarianceType = "full",
) -> Float[Array, ""]:
    r"""AIC as in the thesis, equation (2.15): $-\log L + 2 J$.

    Beside $-\log L$ Akaike's own penalty is $J$; the thesis's, after Manso et al., is twice as strict and kept here.
    Arguments as in `message_length`.
    """
    del observations
    free = mixture.number_of_parameters(covariance_type).astype(mixture.weights.dtype)
    return -log_likelihood + 2 * free


def criterion_score(
    criterion: Criterion,
    mixture: GaussianMixture,
    log_likelihood: Scalar,
    observations: Scalar,
    covariance_type: CovarianceType = "full",
) -> Float[Array, ""]:
    """The score (2.12) by the criterion's short name; the lowest wins."""
    scores = {
        "mdl": minimum_description_length,
        "bic": bayesian_information_criterion,
        "aic": akaike_information_criterion,
    }
    return scores[criterion](mixture, log_likelihood, observations, covariance_type)
