"""The front door: two clouds in, what changed and how probably out; traced, or on the host."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike, PRNGKeyArray

from gmmjax._host import check_static, is_traced
from gmmjax._typing import Scalar
from gmmjax.comparison.choices import Kinds, Method, Solver
from gmmjax.comparison.host_comparison import HostPair, compare_prepared
from gmmjax.comparison.mixture_comparison import (
    Decision,
    Strengths,
    check_strengths,
)
from gmmjax.comparison.result import Comparison
from gmmjax.comparison.traced_comparison import Program, check_dimensions, compared
from gmmjax.errors import ComputationError, check_choice
from gmmjax.mixtures import (
    FitSettings,
    Prior,
    WeightedPoints,
    check_components,
    traced_points,
)
from gmmjax.pair import Pair
from gmmjax.transport import GROUND_COSTS, GroundCost

# How the mixtures of a method are fitted. A message length that is a patience (nats an observation) above the best one
# does not come back; to go on down to one Gaussian would only cost time.
FIT_SETTINGS: Mapping[Method, FitSettings] = {
    "greedy": FitSettings(patience=0.25),
    "transport": FitSettings(patience=0.25),
    "joint": FitSettings(patience=0.02, tolerance=3e-5),
}


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
    r"""Find what changed between two point clouds by one random restart of the thesis's method or of its successors.

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
        pair = HostPair.of(Pair(before, after), Pair(mass_before, mass_after), prior, program)
        result = compare_prepared(pair, key, prior, strengths, program, on_cores=True)
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
