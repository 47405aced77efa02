"""The joint mixture's answer, point by point, as a differentiable function of the prior and the clouds."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float, PRNGKeyArray

from gmmjax._host import check_static
from gmmjax._typing import Array
from gmmjax.changes import JointFitSettings
from gmmjax.comparison import (
    JointMixture,
    SourcedPoints,
    component_posterior,
    density_ratio,
    fit_joint_mixture_from_seeds,
    joined,
    point_posterior,
)
from gmmjax.mixtures import FitSettings, FitStatus, Prior, Standardisation, WeightedPoints
from gmmjax.pair import Pair


class JointPosterior(NamedTuple):
    """The joint mixture of two clouds and what it says of their points.

    Attributes:
        before: the posterior that each point of the before cloud is gone.
        after: the posterior that each point of the after cloud is new.
        joint: the mixture, in the scale of the fit.
        log_likelihood: of the observations, nats, in the scale of the fit.
        message_length: nats, in the scale of the fit.
        result: how the fit ended; derivatives are NaN unless it is `FitStatus.converged`.
    """

    before: Float[Array, " n0"]
    after: Float[Array, " n1"]
    joint: JointMixture
    log_likelihood: Float[Array, ""]
    message_length: Float[Array, ""]
    result: FitStatus


def joint_posterior(
    before: Float[Array, "n0 d"],
    after: Float[Array, "n1 d"],
    *,
    prior: Prior,
    key: PRNGKeyArray,
    volumetric: bool = False,
    max_components: int = JointFitSettings().surface_components,
    settings: FitSettings = JointFitSettings().at_rest,
) -> JointPosterior:
    """The posterior of each point that it changed, by one joint mixture: what `detect_changes` begins with.

    A pure function: `jit`, `vmap`, and derivatives with respect to the prior and the points. It takes the clouds as
    they are: aligned, and of a size that can be fitted at once (some ten thousand points).

    Args:
        before: points of the before cloud.
        after: points of the after cloud, in the same unit and frame.
        prior: in that unit, such as `joint_prior(noise_floor, tolerance)`.
        key: random key of the start.
        volumetric: whether the clouds fill volumes (artificial Gaussians): then a point changed if its component did.
        max_components: that annihilation starts from.
        settings: of the fit; without `polish` there are no derivatives.
    """
    check_static(max_components=max_components, volumetric=volumetric)
    clouds = jnp.asarray(before), jnp.asarray(after)
    # As arrays: a number would be a constant of the program.
    prior = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(*clouds)), prior)
    return _joint_posterior(*clouds, prior, key, volumetric, max_components, settings)


@eqx.filter_jit
def _joint_posterior(
    before: Float[Array, "n0 d"],
    after: Float[Array, "n1 d"],
    prior: Prior,
    key: PRNGKeyArray,
    volumetric: bool,
    max_components: int,
    settings: FitSettings,
) -> JointPosterior:
    clouds = Pair(before, after).map(lambda own: WeightedPoints(own, jnp.ones(len(own), own.dtype)))
    both = joined(clouds)
    frame = Standardisation.of(both.points)
    sourced = SourcedPoints(frame.enter(both.points), both.after)
    end = fit_joint_mixture_from_seeds(sourced, max_components, frame.enter_prior(prior), key, settings)
    coordinates = sourced.points.points
    of_before, of_after = posteriors(
        end.mixture, coordinates[: len(before)], coordinates[len(before) :], volumetric=volumetric
    )
    return JointPosterior(of_before, of_after, end.mixture, end.log_likelihood, end.message_length, end.result)


def posteriors(
    joint: JointMixture, before: Float[Array, "n0 d"], after: Float[Array, "n1 d"], *, volumetric: bool
) -> tuple[Float[Array, " n0"], Float[Array, " n1"]]:
    """The posterior that each point changed; arguments as in `joint_posterior`, in the scale of the mixture."""
    ratio = density_ratio(joint)
    if volumetric:
        return (
            jnp.sum(component_posterior(joint, ratio, before, after=False), axis=0),
            jnp.sum(component_posterior(joint, ratio, after, after=True), axis=0),
        )
    return point_posterior(joint, ratio, before, after=False), point_posterior(joint, ratio, after, after=True)
