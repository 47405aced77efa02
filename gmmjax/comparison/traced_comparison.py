"""The comparison of two clouds as a pure function of arrays, by a mixture of each or by their joint mixture."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float, PRNGKeyArray

from gmmjax._derivatives import nan_derivatives_unless
from gmmjax._typing import Array
from gmmjax.comparison.joint_mixture import JointMixture, log_joint
from gmmjax.comparison.joint_mixture_model import LabelledPoints, fit_joint_mixture_from_seeds, joint_prior
from gmmjax.comparison.mixture_comparison import (
    CHANGED,
    Decision,
    MixtureComparison,
    Strengths,
    compare_mixtures,
    compare_shares,
)
from gmmjax.comparison.result import Comparison
from gmmjax.errors import InputError
from gmmjax.mixtures import (
    RELATIVE_NOISE_FLOOR,
    FitSettings,
    FitStatus,
    GaussianMixture,
    Prior,
    Standardisation,
    WeightedPoints,
    fit_in_frame,
)
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class Program:
    """Static part of a comparison: everything that is not an array."""

    decision: Decision
    max_components: int
    settings: FitSettings


def check_dimensions(clouds: Pair[WeightedPoints]) -> None:
    """Checks that both clouds have the same.

    Raises:
        InputError: they have not.
    """
    of_before, of_after = (cloud.points.shape[1] for cloud in clouds)
    if of_before != of_after:
        raise InputError(f"before has {of_before} columns and after has {of_after}: give clouds of one dimension")


def compared(
    clouds: Pair[WeightedPoints], key: PRNGKeyArray, prior: Prior | None, strengths: Strengths, program: Program
) -> Comparison:
    """`compare` as a pure function of arrays of one type."""
    by_method = of_joint_fit if program.decision.method == "joint" else of_separate_fits
    comparison = by_method(clouds, key, prior, strengths, program)
    comparison = jax.tree.map(lambda leaf: nan_where(comparison.failed, leaf), comparison)
    # Whatever lies between, such as a choice that stops NaN: what failed has no derivatives.
    return nan_derivatives_unless(~comparison.failed, comparison, (*clouds, prior, strengths))


def of_separate_fits(
    clouds: Pair[WeightedPoints], key: PRNGKeyArray, prior: Prior | None, strengths: Strengths, program: Program
) -> Comparison:
    """The comparison by a mixture of each cloud."""
    start_key = jax.random.split(key, 1)[0]
    fits = clouds.map(lambda own: fit_in_frame(own, start_key, prior, None, program.max_components, program.settings))
    mixtures = fits.map(lambda fit: fit.mixture)
    observations = clouds.map(lambda own: jnp.sum(own.mass))
    given = mixtures.before, mixtures.after, observations.before, observations.after
    found = compare_mixtures(*given, program.decision, strengths)
    changed = Pair(found.changed_before, found.changed_after)
    probability = each(point_probability, mixtures, changed, clouds)
    log_likelihood = fits.before.log_likelihood + fits.after.log_likelihood
    return assembled(probability, found, mixtures, log_likelihood, fits.map(lambda fit: fit.result))


def point_probability(
    mixture: GaussianMixture, changed: Float[Array, " k"], cloud: WeightedPoints
) -> Float[Array, " n"]:
    """The probability that each point changed: responsibilities times how much of each component changed."""
    probability = mixture.responsibilities(cloud.points) @ changed
    return jnp.where(cloud.mass > 0, jnp.clip(probability, 0, 1), 0)


def of_joint_fit(
    clouds: Pair[WeightedPoints], key: PRNGKeyArray, prior: Prior | None, strengths: Strengths, program: Program
) -> Comparison:
    """The comparison by the joint mixture, from and to the unit of the points; traced."""
    both = joined(clouds)
    frame = Standardisation.of(both.points)
    dtype, dimension = both.after.dtype, both.points.points.shape[1]
    default = joint_prior(RELATIVE_NOISE_FLOOR[str(dtype)], 0.0, dimension)
    in_frame = (
        jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), default) if prior is None else frame.enter_prior(prior)
    )
    sourced = LabelledPoints(frame.enter(both.points), both.after)
    end = fit_joint_mixture_from_seeds(sourced, program.max_components, in_frame, key, program.settings)
    scaled = jax.tree.map(lambda strength: strength / frame.spread, strengths)
    before, after, found = compare_shares(end.mixture, program.decision, scaled)
    found = eqx.tree_at(
        lambda own: (own.emd, own.emd_unchanged), found, (found.emd * frame.spread, found.emd_unchanged * frame.spread)
    )
    coordinates, split = sourced.points.points, len(clouds.before.points)
    probability = Pair(
        _joint_probability(end.mixture, found.changed_before, coordinates[:split], clouds.before.mass, after=False),
        _joint_probability(end.mixture, found.changed_after, coordinates[split:], clouds.after.mass, after=True),
    )
    observations = jnp.sum(both.points.mass)
    log_likelihood = end.log_likelihood - observations * dimension * jnp.log(frame.spread)
    mixtures = Pair(frame.leave(before), frame.leave(after))
    # A joint mixture of one cloud alone says nothing of the other.
    both_seen = (jnp.sum(clouds.before.mass) > 0) & (jnp.sum(clouds.after.mass) > 0)
    status = FitStatus.where(both_seen, end.result, FitStatus.invalid_input)
    return assembled(probability, found, mixtures, log_likelihood, Pair(status, status))


def joined(clouds: Pair[WeightedPoints]) -> LabelledPoints:
    """The points of both clouds, and which cloud each is of."""
    points, mass = (jnp.concatenate([getattr(own, name) for own in clouds]) for name in ("points", "mass"))
    sizes = [len(own.mass) for own in clouds]
    source = jnp.concatenate([jnp.zeros(sizes[0], points.dtype), jnp.ones(sizes[1], points.dtype)])
    return LabelledPoints(WeightedPoints(points, mass), source)


def _joint_probability(
    joint: JointMixture, changed: JaxArray, points: JaxArray, mass: JaxArray, after: bool
) -> JaxArray:
    responsibilities = jax.nn.softmax(log_joint(joint, points, after), axis=0)
    return jnp.where(mass > 0, jnp.clip(changed @ responsibilities[:-1], 0, 1), 0)


def assembled(
    probability: Pair[Any],
    found: MixtureComparison,
    mixtures: Pair[GaussianMixture],
    log_likelihood: Float[Array, ""],
    statuses: Pair[FitStatus],
) -> Comparison:
    """The record of a comparison, whether it failed or not."""
    return Comparison(
        probability_before=probability.before,
        probability_after=probability.after,
        changed_before=found.changed_before,
        changed_after=found.changed_after,
        disappeared=found.changed_before > CHANGED,
        appeared=found.changed_after > CHANGED,
        emd=found.emd,
        emd_unchanged=found.emd_unchanged,
        plan=found.plan,
        mixture_before=mixtures.before,
        mixture_after=mixtures.after,
        log_likelihood=log_likelihood,
        fit_before=statuses.before,
        fit_after=statuses.after,
        transport=found.result,
    )


def nan_where(failed: Bool[Array, ""], leaf: Any) -> Any:
    """A leaf of a comparison; where it failed, NaN in place of numbers and no component that changed."""
    library: Any = np if isinstance(leaf, np.ndarray) else jnp
    if np.issubdtype(leaf.dtype, np.floating):
        return library.where(failed, np.asarray(np.nan, leaf.dtype), leaf)
    return leaf & ~failed if leaf.dtype == np.bool_ else leaf
