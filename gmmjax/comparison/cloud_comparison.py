"""The comparison of two clouds as one function: mixtures, earth mover's distance, what changed, and how probably."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array as JaxArray
from jaxtyping import ArrayLike, Bool, Float, PRNGKeyArray

from gmmjax._derivatives import nan_derivatives_unless
from gmmjax._host import check_static, is_traced
from gmmjax._typing import Array, Scalar
from gmmjax.comparison.choices import Kinds, Method, Solver
from gmmjax.comparison.joint_mixture import JointMixture, log_joint
from gmmjax.comparison.joint_mixture_model import SourcedPoints, fit_joint_mixture_from_seeds, joint_prior
from gmmjax.comparison.mixture_comparison import (
    CHANGED,
    Decision,
    MixtureComparison,
    Strengths,
    check_strengths,
    compare_mixtures,
    compare_shares,
)
from gmmjax.comparison.result import Comparison
from gmmjax.errors import ComputationError, InputError, check_choice
from gmmjax.mixtures import (
    RELATIVE_NOISE_FLOOR,
    FitSettings,
    FitStatus,
    GaussianMixture,
    Prior,
    Standardisation,
    WeightedPoints,
    check_components,
    fit_in_frame,
    traced_points,
)
from gmmjax.pair import Pair, each
from gmmjax.transport import GROUND_COSTS, GroundCost

# How the mixtures of a method are fitted. A message length that is a patience (nats an observation) above the best one
# does not come back; to go on down to one Gaussian would only cost time.
FIT_SETTINGS: Mapping[Method, FitSettings] = {
    "greedy": FitSettings(patience=0.25),
    "transport": FitSettings(patience=0.25),
    "joint": FitSettings(patience=0.02, tolerance=3e-5),
}


@dataclasses.dataclass(frozen=True)
class Program:
    """What is compiled: everything of a comparison that is no array."""

    decision: Decision
    max_components: int
    settings: FitSettings


def compare(
    before: ArrayLike,
    after: ArrayLike,
    *,
    key: PRNGKeyArray,
    mass_before: ArrayLike | None = None,
    mass_after: ArrayLike | None = None,
    prior: Prior | None = None,
    max_components: int = 25,
    method: Method = "greedy",
    kinds: Kinds = "both",
    ground_cost: str | GroundCost | None = None,
    solver: Solver = "exact",
    penalty: Scalar | None = None,
    epsilon: Scalar | None = None,
    temperature: Scalar | None = None,
    settings: FitSettings | None = None,
    throw: bool = True,
) -> Comparison:
    r"""What changed between two point clouds, by one random restart: the thesis's method, or one of its successors.

    On traced arrays, inside `jit`, `vmap`, `grad`, `jvp` or `shard_map`, it is a pure function in the dtype of the
    points, checks shapes only, and failure is a status of the result. On concrete arrays it is a host function: it
    checks its input, computes in float64 whatever JAX's setting, and returns NumPy arrays.

    Each cloud gets a mixture by EM with annihilation (2.2.2), the mixtures are compared by the earth mover's distance
    (2.2.3), and the method decides which components changed:

    - "greedy": Algorithm 1 (2.2.4), which removes the component whose removal lowers the distance most, and again.
    - "transport": points are matched by partial transport, and a component changed if most of its points are left
      unmatched. Nothing is renormalised, so that what changed does not displace the rest.
    - "joint": one mixture is fitted to both clouds, and what changed is in each component's share of either cloud.

    With `settings=FitSettings(polish=True)` all results have derivatives with respect to the points, the masses, the
    leaves of the prior, and penalty, epsilon and temperature; they hold while no component lives or dies. Which
    components "greedy" and "transport" take for changed is a hard decision, whose derivative is 0 nearly everywhere:
    tune by the probabilities with a `temperature`, by which it is a smooth one. The plan has no derivatives.

    Args:
        before: points of the before cloud [n0, d], in any unit.
        after: points of the after cloud [n1, d], in the same unit and frame.
        key: random key of the starts, of both fits, as in `fit_mixture`: equal clouds have equal mixtures.
        mass_before: how many observations each point stands for [n0]; default 1 each. Mass 0 is padding.
        mass_after: the same of the after cloud [n1].
        prior: belief about the mixtures; default as in `fit_mixture`, for "joint" `joint_prior` with the same noise
            floor.
        max_components: EM starts from this number of components (K_max); of "joint", for both clouds together.
        method: "greedy", "transport" or "joint".
        kinds: what is looked for: "both", "appeared" or "disappeared".
        ground_cost: between components, as in `earth_movers_distance`; default "euclidean", for "transport"
            "bures_wasserstein".
        solver: of the earth mover's distances, "exact" or "sinkhorn".
        penalty: of "transport": mass is matched over at most twice this distance; default as in `unmatched_shares`.
        epsilon: entropy of the Sinkhorn solver; default 5 % of the mean ground cost.
        temperature: in the unit of the points, of a smooth decision: for "greedy" the gain in the distance at which
            the odds that a component changed are e to 1, for "transport" the entropy of the plan.
        settings: how EM runs; default `FIT_SETTINGS` of the method.
        throw: on concrete arrays raise if there is no result; else look at `Comparison.failed`.

    Returns:
        The comparison. The mean over restarts is `averaged(jax.vmap(...))`, many pairs on the host are
        `compare_many`.

    Raises:
        InputError: clouds that are not finite, have too few points, differ in dimension or have the wrong shape;
            masses that are all 0 or negative; more components than points; a number that is out of its range or of no
            use to the method; a choice that is unknown.
        ComputationError: there is no result, and `throw`.
    """
    strengths, program = planned(
        method, kinds, ground_cost, solver, max_components, settings, Strengths(penalty, epsilon, temperature)
    )
    given = before, after, mass_before, mass_after, prior, key, strengths
    if not is_traced(given):
        from gmmjax.comparison.host_comparison import compare_on_host

        result = compare_on_host(Pair(before, after), Pair(mass_before, mass_after), key, prior, strengths, program)
        if throw and bool(result.failed):
            raise ComputationError(f"the clouds could not be compared: {result.why_failed()}")
        return result
    clouds = Pair(traced_points(before, mass_before), traced_points(after, mass_after))
    check_dimensions(clouds)
    for cloud in clouds:
        check_components(max_components, len(cloud.points))
    # As arrays of one type: a number would be a constant of the program.
    dtype = jnp.result_type(clouds.before.points, clouds.after.points)
    prior, strengths = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype), (prior, strengths))
    comparison: Comparison = _traced(clouds.before, clouds.after, key, prior, strengths, program)
    return comparison


def planned(
    method: Method,
    kinds: Kinds,
    ground_cost: str | GroundCost | None,
    solver: Solver,
    max_components: int,
    settings: FitSettings | None,
    strengths: Strengths,
) -> tuple[Strengths, Program]:
    """The arguments of a comparison as its numbers and what is compiled.

    Raises:
        InputError: an unknown choice, or a number that is of no use to it.
    """
    check_static(max_components=max_components)
    if isinstance(ground_cost, str):
        check_choice("ground_cost", ground_cost, tuple(GROUND_COSTS))
        ground_cost = GROUND_COSTS[ground_cost]
    decision = Decision(method, kinds, solver, ground_cost)
    check_strengths(decision, strengths)
    return strengths, Program(decision, max_components, FIT_SETTINGS[method] if settings is None else settings)


def check_dimensions(clouds: Pair[WeightedPoints]) -> None:
    """Checks that both clouds have the same.

    Raises:
        InputError: they have not.
    """
    of_before, of_after = (cloud.points.shape[1] for cloud in clouds)
    if of_before != of_after:
        raise InputError(f"before has {of_before} columns and after has {of_after}: give clouds of one dimension")


@eqx.filter_jit
def _traced(
    before: WeightedPoints,
    after: WeightedPoints,
    key: PRNGKeyArray,
    prior: Prior | None,
    strengths: Strengths,
    program: Program,
) -> Comparison:
    return compared(Pair(before, after), key, prior, strengths, program)


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
    sourced = SourcedPoints(frame.enter(both.points), both.after)
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


def joined(clouds: Pair[WeightedPoints]) -> SourcedPoints:
    """The points of both clouds, and which cloud each is of."""
    points, mass = (jnp.concatenate([getattr(own, name) for own in clouds]) for name in ("points", "mass"))
    sizes = [len(own.mass) for own in clouds]
    source = jnp.concatenate([jnp.zeros(sizes[0], points.dtype), jnp.ones(sizes[1], points.dtype)])
    return SourcedPoints(WeightedPoints(points, mass), source)


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
