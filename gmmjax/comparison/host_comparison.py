"""Comparisons on the host: checked once, padded to few sizes, each stage a compiled program that pairs share."""

import dataclasses
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float, PRNGKeyArray

from gmmjax._host import to_numpy
from gmmjax._programs import lru_jit
from gmmjax._typing import Array
from gmmjax.comparison.mixture_comparison import MixtureComparison, Strengths, compare_mixtures
from gmmjax.comparison.result import Comparison
from gmmjax.comparison.traced_comparison import (
    Program,
    assembled,
    check_dimensions,
    compared,
    nan_where,
    point_probability,
)
from gmmjax.errors import InputError
from gmmjax.mixtures import (
    FramedCloud,
    GaussianMixture,
    Prior,
    WeightedPoints,
    check_components,
    check_prior,
    checked_points,
)
from gmmjax.pair import Pair, each, parallel_map


@dataclasses.dataclass(frozen=True, eq=False)
class HostPair:
    """Two clouds that are ready for any number of restarts.

    Attributes:
        sizes: how many points they have.
        padded: both, in float64, padded to sizes that pairs share.
        framed: what a mixture is fitted to, of each; None for the joint mixture.
    """

    sizes: Pair[int]
    padded: Pair[WeightedPoints]
    framed: Pair[FramedCloud] | None

    @classmethod
    def of(cls, points: Pair[ArrayLike], mass: Pair[Any], prior: Prior | None, program: Program) -> "HostPair":
        """Checks both clouds.

        Raises:
            InputError: as `compare`; it names the cloud.
        """
        clouds = each(_checked, Pair("before", "after"), points, mass)
        check_dimensions(clouds)
        usable = [int(np.count_nonzero(cloud.mass)) for cloud in clouds]
        joint = program.decision.method == "joint"
        check_components(program.max_components, sum(usable) if joint else min(usable))
        if prior is not None:
            check_prior(prior, clouds.before.points.shape[1])
        return cls(
            sizes=clouds.map(lambda cloud: len(cloud.mass)),
            padded=clouds.map(lambda cloud: cloud.padded()),
            framed=None if joint else clouds.map(lambda cloud: FramedCloud.of(cloud, prior, program.settings)),
        )

    def cut(self, comparison: Comparison) -> Comparison:
        """The comparison without the padding of the points; with any leading axes."""
        return dataclasses.replace(
            comparison,
            probability_before=comparison.probability_before[..., : self.sizes.before],
            probability_after=comparison.probability_after[..., : self.sizes.after],
        )


def _checked(name: str, points: ArrayLike, mass: ArrayLike | None) -> WeightedPoints:
    try:
        return checked_points(points, mass)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def compare_prepared(
    pair: HostPair,
    key: PRNGKeyArray,
    prior: Prior | None,
    strengths: Strengths,
    program: Program,
    *,
    on_cores: bool = False,
) -> Comparison:
    """One restart of a pair; on one core, unless it may take two.

    Args:
        pair: both clouds.
        key: of the starts.
        prior: as of `compare`.
        strengths: the numbers of the decision.
        program: what is compiled.
        on_cores: whether both clouds are fitted at the same time.
    """
    strengths = jax.tree.map(np.float64, strengths)
    with jax.enable_x64(True):
        if pair.framed is None:
            prior = jax.tree.map(np.float64, prior)
            whole = to_numpy(_joint(pair.padded.before, pair.padded.after, key, prior, strengths, program=program))
            return pair.cut(whole)
        both = parallel_map if on_cores else each
        # As of `fit_mixture`.
        start_key = jax.random.split(key, 1)[0]
        fits = both(lambda own: own.fit(start_key, program.max_components, program.settings), pair.framed)
        mixtures = fits.map(lambda fit: fit.mixture)
        observations = pair.framed.map(lambda own: np.float64(own.observations))
        given = mixtures.before, mixtures.after, observations.before, observations.after
        found = to_numpy(_changed(*given, strengths, program=program))
        changed = Pair(found.changed_before, found.changed_after)
        probability = each(_probability, mixtures, changed, pair.padded).map(np.asarray)
        log_likelihood = np.asarray(fits.before.log_likelihood + fits.after.log_likelihood)
        statuses = fits.map(lambda fit: fit.result)
        comparison = assembled(probability, found, mixtures, log_likelihood, statuses)
        bad = np.asarray(comparison.failed)
        if bad:
            comparison = jax.tree.map(lambda leaf: nan_where(bad, np.asarray(leaf)), comparison)
        return pair.cut(comparison)


def compile_decision(pair: HostPair, strengths: Strengths, program: Program) -> None:
    """Compiles what `compare_prepared` runs after the fits, by a comparison of mixtures that were not fitted."""
    if pair.framed is None:
        return
    slots, dimension = program.max_components, pair.padded.before.points.shape[1]
    mixture = GaussianMixture(
        np.full(slots, 1 / slots),
        np.zeros((slots, dimension)),
        np.tile(np.eye(dimension), (slots, 1, 1)),
        np.ones(slots, bool),
    )
    with jax.enable_x64(True):
        one = np.float64(1)
        found = to_numpy(_changed(mixture, mixture, one, one, jax.tree.map(np.float64, strengths), program=program))
        each(_probability, Pair(mixture, mixture), Pair(found.changed_before, found.changed_after), pair.padded)


@lru_jit
def _joint(
    before: WeightedPoints,
    after: WeightedPoints,
    key: PRNGKeyArray,
    prior: Prior | None,
    strengths: Strengths,
    *,
    program: Program,
) -> Comparison:
    return compared(Pair(before, after), key, prior, strengths, program)


@lru_jit
def _changed(
    before: GaussianMixture,
    after: GaussianMixture,
    points_before: Float[Array, ""],
    points_after: Float[Array, ""],
    strengths: Strengths,
    *,
    program: Program,
) -> MixtureComparison:
    return compare_mixtures(before, after, points_before, points_after, program.decision, strengths)


@lru_jit
def _probability(mixture: GaussianMixture, changed: Float[Array, " k"], cloud: WeightedPoints) -> Float[Array, " n"]:
    return point_probability(mixture, changed, cloud)
