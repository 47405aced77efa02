"""Changed components of two mixtures: the decision of each method (thesis 2.2.4, and its two successors)."""

import dataclasses
from typing import get_args

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array as JaxArray
from jaxtyping import Bool, Float

from gmmjax._derivatives import nan_derivatives_unless
from gmmjax._host import check_static
from gmmjax._typing import Array, Scalar
from gmmjax.comparison.choices import Kinds, Method, Solver
from gmmjax.comparison.greedy_removal import kept_by_removal, removal_odds
from gmmjax.comparison.joint_mixture import JointMixture, changed_share, density_ratio
from gmmjax.comparison.pruned_distance import PrunedDistance
from gmmjax.comparison.unmatched_mass import unmatched_shares
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures import GaussianMixture
from gmmjax.transport import (
    GroundCost,
    TransportStatus,
    bures_wasserstein_distance,
    distance_of_means,
)

# From this share of its observations on, a component is called changed.
CHANGED = 0.5


@dataclasses.dataclass(frozen=True)
class Decision:
    """Parameters of the decision which components changed.

    Attributes:
        method: "greedy" for Algorithm 1 of the thesis, "transport" for the points that partial transport leaves
            unmatched, "joint" for the shares of one mixture of both clouds.
        kinds: what is looked for.
        solver: of the earth mover's distances.
        ground_cost: between components; None: the distance of the means, for "transport" the Bures-Wasserstein one.
    """

    method: Method = "greedy"
    kinds: Kinds = "both"
    solver: Solver = "exact"
    ground_cost: GroundCost | None = None

    def __post_init__(self) -> None:
        """Checks every setting.

        Raises:
            InputError: an unknown one, by name, or one that is traced.
        """
        check_static(method=self.method, kinds=self.kinds, solver=self.solver)
        for name, choices in (("method", Method), ("kinds", Kinds), ("solver", Solver)):
            check_choice(name, getattr(self, name), get_args(choices))

    @property
    def cost(self) -> GroundCost:
        """The ground cost between components."""
        default = bures_wasserstein_distance if self.method == "transport" else distance_of_means
        return default if self.ground_cost is None else self.ground_cost


class Strengths(eqx.Module):
    """The numbers of a decision, which can be traced; in the unit of the points, None for their defaults.

    Attributes:
        penalty: of "transport", see `unmatched_shares`.
        epsilon: entropy of the Sinkhorn solver; default 5 % of the mean ground cost.
        temperature: with which "greedy" and "transport" decide smoothly; None: their decision is hard.
    """

    penalty: Scalar | None = None
    epsilon: Scalar | None = None
    temperature: Scalar | None = None

    @property
    def in_domain(self) -> Bool[JaxArray, ""]:
        """True if all are positive and finite: `check_strengths` for traced numbers."""
        numbers = [jnp.asarray(number) for number in jax.tree.leaves(self)]
        return jnp.all(jnp.asarray([(number > 0) & jnp.isfinite(number) for number in numbers], bool))


class MixtureComparison(eqx.Module):
    """Changes between two mixtures.

    Attributes:
        changed_before: how much of each component disappeared, 0 to 1; 0 in dead slots.
        changed_after: how much of each component appeared.
        emd: earth mover's distance between the mixtures, in the unit of the means.
        emd_unchanged: the same without the components that changed; NaN where one of the mixtures has no other ones.
        plan: of `emd`: the weight that is moved from each component before to each component after. Its derivatives
            are NaN; those of `emd` are by `jax.grad` of that.
        result: how the transport problems ended; the first that was not solved counts.
    """

    changed_before: Float[Array, " k0"]
    changed_after: Float[Array, " k1"]
    emd: Float[Array, ""]
    emd_unchanged: Float[Array, ""]
    plan: Float[Array, "k0 k1"]
    result: TransportStatus


def compare_mixtures(
    before: GaussianMixture,
    after: GaussianMixture,
    points_before: Scalar,
    points_after: Scalar,
    decision: Decision,
    strengths: Strengths = Strengths(),
    threshold: float = CHANGED,
) -> MixtureComparison:
    """Compares the mixtures of two clouds that were fitted by themselves. A pure function of arrays.

    Args:
        before: mixture of the before cloud.
        after: mixture of the after cloud.
        points_before: observations in the before cloud.
        points_after: observations in the after cloud.
        decision: "greedy" or "transport".
        strengths: its numbers.
        threshold: the unmatched share from which on "transport" calls a component changed.
    """
    distance = PrunedDistance.between(before, after, decision.cost, decision.solver, strengths.epsilon)
    if decision.method == "greedy":
        changed, solved = _by_removal(distance, before, after, decision, strengths)
    else:
        unmatched = unmatched_shares(
            before, after, points_before, points_after, strengths.penalty, decision.cost, strengths.temperature
        )
        shares = unmatched.share_before, unmatched.share_after
        hard = [(share > threshold).astype(share.dtype) for share in shares]
        changed, solved = shares if strengths.temperature is not None else tuple(hard), unmatched.valid
    exact = decision.solver == "exact" and (decision.method == "greedy" or strengths.temperature is None)
    return _comparison(distance, _of_kinds(changed, decision.kinds), before, after, solved, exact, strengths)


def compare_shares(
    joint: JointMixture, decision: Decision, strengths: Strengths = Strengths()
) -> tuple[GaussianMixture, GaussianMixture, MixtureComparison]:
    """Compares two clouds by their joint mixture; the other arguments as of `compare_mixtures`.

    Returns:
        The mixture of either cloud, whose components are shared and whose weights are its own, and what changed.
    """
    before, after = of_cloud(joint, after=False), of_cloud(joint, after=True)
    ratio = density_ratio(joint)
    changed = changed_share(joint, ratio, after=False), changed_share(joint, ratio, after=True)
    distance = PrunedDistance.between(before, after, decision.cost, decision.solver, strengths.epsilon)
    changed, exact = _of_kinds(changed, decision.kinds), decision.solver == "exact"
    return before, after, _comparison(distance, changed, before, after, jnp.asarray(True), exact, strengths)


def of_cloud(joint: JointMixture, after: bool) -> GaussianMixture:
    """The mixture of one cloud: the shared components, with that cloud's weights."""
    shared = joint.mixture
    weights = shared.weights * (joint.share_after if after else 1 - joint.share_after)
    return GaussianMixture(weights / jnp.sum(weights), shared.means, shared.covariances, shared.live)


def _by_removal(
    distance: PrunedDistance, before: GaussianMixture, after: GaussianMixture, decision: Decision, strengths: Strengths
) -> tuple[tuple[JaxArray, JaxArray], JaxArray]:
    live = jnp.asarray(before.live), jnp.asarray(after.live)
    *kept, valid = kept_by_removal(distance, *live, decision.kinds)
    if strengths.temperature is not None:
        return removal_odds(distance, (kept[0], kept[1]), live, decision.kinds, strengths.temperature), valid
    disappeared, appeared = ((own & ~left).astype(distance.cost.dtype) for own, left in zip(live, kept, strict=True))
    return (disappeared, appeared), valid


def _of_kinds(changed: tuple[JaxArray, JaxArray], kinds: Kinds) -> tuple[JaxArray, JaxArray]:
    before, after = changed
    return (
        jnp.zeros_like(before) if kinds == "appeared" else before,
        jnp.zeros_like(after) if kinds == "disappeared" else after,
    )


def _comparison(
    distance: PrunedDistance,
    changed: tuple[JaxArray, JaxArray],
    before: GaussianMixture,
    after: GaussianMixture,
    solved: JaxArray,
    exact: bool,
    strengths: Strengths,
) -> MixtureComparison:
    live = jnp.asarray(before.live), jnp.asarray(after.live)
    kept = [own & (share <= CHANGED) for own, share in zip(live, changed, strict=True)]
    left = jnp.any(kept[0]) & jnp.any(kept[1])
    # An empty problem is no failure: its distance is undefined, and that of the whole takes its place until then.
    whole = distance(*live)
    pruned = distance(*(jnp.where(left, own, every) for own, every in zip(kept, live, strict=True)))
    result = TransportStatus.where(whole.result == TransportStatus.optimal, pruned.result, whole.result)
    undecided = (result == TransportStatus.optimal) & ~solved
    gave_up = TransportStatus.pivot_limit if exact else TransportStatus.not_converged
    result = TransportStatus.where(undecided, gave_up, result)
    return MixtureComparison(
        *changed,
        emd=whole.cost,
        emd_unchanged=jnp.where(left, pruned.cost, jnp.nan),
        plan=nan_derivatives_unless(jnp.asarray(False), whole.plan, distance),
        result=TransportStatus.where(strengths.in_domain, result, TransportStatus.invalid_input),
    )


def check_strengths(decision: Decision, strengths: Strengths) -> None:
    """Checks which numbers are of use to a decision, and those that are not traced.

    Raises:
        InputError: one that is of no use, or not positive, by name.
    """
    uses = {
        "penalty": decision.method == "transport",
        "epsilon": decision.solver == "sinkhorn",
        "temperature": decision.method != "joint",
    }
    remedies = {"penalty": 'method="transport"', "epsilon": 'solver="sinkhorn"', "temperature": "the other methods"}
    for name, used in uses.items():
        value = getattr(strengths, name)
        if value is not None and not used:
            raise InputError(f"{name} is of use to {remedies[name]} only: leave it out")
        if value is not None and not isinstance(value, jax.core.Tracer) and not 0 < float(value) < float("inf"):
            raise InputError(f"{name}={float(value):g} must be a positive number, in the unit of the points")
