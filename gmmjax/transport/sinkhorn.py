"""Entropic transport by Sinkhorn's iteration: a smooth stand-in for the exact solver."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from gmmjax._derivatives import without_derivatives
from gmmjax._host import check_static, float64_on_host
from gmmjax._matrix_products import in_full_precision
from gmmjax._typing import Array
from gmmjax._varying import varying_as
from gmmjax.transport.embedding import Balanced, Problem, check_shapes, checked
from gmmjax.transport.result import TransportResult, TransportStatus, trusted_cost

# Sweeps between two steps of Newton's method, which may change the logarithm of a scaling by no more than the second
# number: where the plan is far off, a longer step leads farther off.
SWEEPS, LONGEST_STEP = 10, 1.0
# The largest cost in units of the entropy with which the iteration begins.
FIRST_COST = 4.0
# Share of the mass that may be in the wrong column: of a solution, and of one that is iterated no further.
SOLVED = {"float64": 1e-6, "float32": 1e-4}
AT_REST = {"float64": 1e-13, "float32": 1e-6}


class _Arguments(NamedTuple):
    mass_before: Array
    mass_after: Array
    cost: Array
    epsilon: Array | None


class _Scaled(NamedTuple):
    """A balanced problem of total mass 1, in which costs are in units of epsilon."""

    supply: Array
    demand: Array
    cost: Array


@float64_on_host
def sinkhorn(
    mass_before: Float[Array, " k0"],
    mass_after: Float[Array, " k1"],
    cost: Float[Array, "k0 k1"],
    *,
    epsilon: Float[Array, ""] | float | None = None,
    max_iterations: int = 2000,
) -> TransportResult:
    r"""Solve (2.21) with the entropy of the plan added, $\sum P C + \epsilon \sum P (\log P - 1)$.

    Unlike the exact plan, this one changes smoothly with masses and costs, and so does its cost. The derivatives of
    `cost` are those of the reported number by masses (of dead components, too), costs and epsilon, with all that
    follows from a changing plan, in forward and reverse mode; second derivatives are an error. Where totals are equal
    those by masses hold in directions that keep them equal. As epsilon falls the
    cost falls to the exact one, at the price of more iterations.

    Sinkhorn's sweeps alternate with steps of Newton's method, without which near ties take thousands of sweeps, and the
    entropy falls to epsilon by and by, without which clusters far from each other do.

    Reference: Cuturi, "Sinkhorn distances: lightspeed computation of optimal transport", NIPS 2013; Brauer, Clason,
    Lorenz and Wirth, "A Sinkhorn-Newton method for entropic optimal transport", 2017; Schmitzer, "Stabilized sparse
    scaling algorithms for entropy regularized transport problems", SIAM Journal on Scientific Computing 41, 2019.

    Args:
        mass_before: nonnegative masses, in any unit; 0 marks a dead component.
        mass_after: masses in the same unit; the totals may differ.
        cost: ground costs, finite, in any unit.
        epsilon: how much entropy, positive, in the unit of the ground costs; by default 5 % of the live ones' mean,
            which is not continuous where a component comes to life: its derivative there is that for the others' mean.
        max_iterations: sweeps after which to give up.

    Returns:
        The result as of `exact_transport`; `cost` is $\sum P C$ over the total flow, without the entropy. The
        potentials are those of the entropic problem, 0 for dead components. `not_converged` when the plan's masses are
        still off by more than 1e-6 (float64; 1e-4 in float32) of the total.
    """
    check_static(max_iterations=max_iterations)
    check_shapes(mass_before, mass_after, cost)
    strength = None if epsilon is None else jnp.asarray(epsilon)
    given = _Arguments(jnp.asarray(mass_before), jnp.asarray(mass_after), jnp.asarray(cost), strength)
    return _solve(given, max_iterations)


@eqx.filter_jit
def _solve(arguments: _Arguments, max_iterations: int) -> TransportResult:
    problem, balanced, strength, scaled = _embedded(jax.lax.stop_gradient(arguments))
    scaling, error = _column_scaling(scaled, max_iterations)
    total = balanced.supply.sum()
    shares = _row_shares(scaled, scaling)
    plan = balanced.supply[:, None] * shares
    live_rows, live_columns = balanced.supply > 0, balanced.demand > 0
    of_rows = strength * (_row_scaling(scaled, scaling) + jnp.log(jnp.where(live_rows, scaled.supply, 1)))
    of_columns = strength * (scaling + jnp.log(jnp.where(live_columns, scaled.demand, 1)))
    potentials = balanced.centred(jnp.where(live_rows, of_rows, 0), jnp.where(live_columns, of_columns, 0))
    converged = error <= SOLVED[str(scaled.cost.dtype)]
    status = problem.status(converged, TransportStatus.not_converged)
    cost = problem.per_flow((plan[:-1, :-1] * problem.cost).sum())
    cost = _with_derivatives(arguments, cost, scaling, status == TransportStatus.optimal)
    solved = total > 0
    return TransportResult(
        cost=trusted_cost(cost, status, arguments),
        plan=jnp.where(solved, plan[:-1, :-1], 0),
        potentials=(
            jnp.where(live_rows[:-1], potentials[0], 0),
            jnp.where(live_columns[:-1], potentials[1], 0),
        ),
        unmatched=(
            problem.mass_before - balanced.supply[:-1] + jnp.where(solved, plan[:-1, -1], 0),
            problem.mass_after - balanced.demand[:-1] + jnp.where(solved, plan[-1, :-1], 0),
        ),
        result=status,
    )


def _embedded(arguments: _Arguments) -> tuple[Problem, Balanced, Float[Array, ""], _Scaled]:
    """The problem as it was given, balanced, and in the units of epsilon."""
    mass_before, mass_after, cost, epsilon = arguments
    # An epsilon that is not positive is as wrong as a negative penalty.
    problem = checked(mass_before, mass_after, cost, 0.0 if epsilon is None else jnp.where(epsilon > 0, epsilon, -1))
    balanced = problem.with_dummies()
    supply, demand = balanced.supply, balanced.demand
    if epsilon is None:
        live = (supply > 0)[:-1, None] & (demand > 0)[None, :-1]
        strength = default_epsilon(problem.cost, live)
    else:
        strength = jnp.where(problem.valid, epsilon.astype(problem.cost.dtype), 1)
    total = supply.sum()
    total = jnp.where(total > 0, total, 1)
    return problem, balanced, strength, _Scaled(supply / total, demand / total, balanced.cost / strength)


def default_epsilon(cost: Float[Array, "k0 k1"], live: Bool[Array, "k0 k1"]) -> Float[Array, ""]:
    """5 % of the mean cost between live components; padding has no say in it."""
    mean = jnp.where(live, cost, 0).sum() / jnp.maximum(live.sum(), 1).astype(cost.dtype)
    return 0.05 * jnp.where(mean > 0, mean, 1)


def _log_joint(scaled: _Scaled, scaling: Float[Array, " columns"]) -> Float[Array, "rows columns"]:
    return (jnp.log(scaled.demand) + scaling)[None] - scaled.cost


def _row_scaling(scaled: _Scaled, scaling: Float[Array, " columns"]) -> Float[Array, " rows"]:
    r"""$u$ of the plan $a_i b_j e^{u_i + v_j - C_{ij} / \epsilon}$, from $v$; finite for dead rows, too."""
    return -jax.nn.logsumexp(_log_joint(scaled, scaling), axis=1)


def _row_shares(scaled: _Scaled, scaling: Float[Array, " columns"]) -> Float[Array, "rows columns"]:
    """Shares of each row's mass by column; for a dead row, those that its first mass would have."""
    return jax.nn.softmax(_log_joint(scaled, scaling), axis=1)


def _columns_log_joint(scaled: _Scaled, scaling: Float[Array, " columns"]) -> Float[Array, "rows columns"]:
    return (jnp.log(scaled.supply) + _row_scaling(scaled, scaling))[:, None] - scaled.cost


def _sweep(scaled: _Scaled, scaling: Float[Array, " columns"]) -> Float[Array, " columns"]:
    return -jax.nn.logsumexp(_columns_log_joint(scaled, scaling), axis=0)


class _Sweeping(NamedTuple):
    """The columns' $v$ at a level, which is epsilon's share of the entropy; how far it is off, and was; the sweeps."""

    scaling: Array
    level: Array
    error: Array
    last: Array
    sweeps: Array


def _column_scaling(scaled: _Scaled, max_iterations: int) -> tuple[Float[Array, " columns"], Float[Array, ""]]:
    """The columns' $v$, and the share of the mass that is in the wrong column; see `_row_scaling`.

    From much entropy to little, halved where the scalings are right: what hardly any mass connects, as the
    clusters of two scenes of which little changed, takes thousands of sweeps from afar.
    """
    solved, at_rest = (limits[str(scaled.cost.dtype)] for limits in (SOLVED, AT_REST))

    def further(state: _Sweeping) -> _Sweeping:
        own = scaled._replace(cost=scaled.cost * state.level)
        scaling = jax.lax.fori_loop(0, SWEEPS, lambda _, scaling: _sweep(own, scaling), state.scaling)
        scaling = scaling + _newton_step(own, scaling)
        error = jnp.sum(own.demand * jnp.abs(_sweep(own, scaling) - scaling))
        onward = (state.level < 1) & (error <= solved)
        level = jnp.where(onward, jnp.minimum(2 * state.level, 1), state.level)
        # Potentials stay, in units of epsilon.
        scaling = scaling * (level / state.level)
        return _Sweeping(scaling, level, jnp.where(onward, jnp.inf, error), state.error, state.sweeps + SWEEPS)

    def unfinished(state: _Sweeping) -> Array:
        # What rounding leaves no longer shrinks.
        still = (state.error <= solved) & (state.error >= state.last)
        at_end = (state.level >= 1) & ((state.error <= at_rest) | still)
        return ~at_end & (state.sweeps < max_iterations)

    infinity = jnp.asarray(jnp.inf, scaled.cost.dtype)
    live = (scaled.supply > 0)[:, None] & (scaled.demand > 0)[None]
    level = jnp.minimum(FIRST_COST / jnp.max(jnp.where(live, scaled.cost, FIRST_COST)), 1)
    start = _Sweeping(jnp.zeros_like(scaled.demand), level, infinity, infinity, jnp.asarray(0, jnp.int32))
    end = jax.lax.while_loop(unfinished, further, varying_as(start, scaled))
    return end.scaling, jnp.where(end.level >= 1, end.error, jnp.inf)


@in_full_precision
def _newton_step(scaled: _Scaled, scaling: Float[Array, " columns"]) -> Float[Array, " columns"]:
    """A step to where a sweep changes nothing, or none where its system cannot be solved."""
    stay = _transitions(scaled, scaling)
    # The constant that may move from u to v, which has no effect, is held by the last term.
    system = jnp.eye(len(stay), dtype=stay.dtype) - stay + scaled.demand[None]
    step = jnp.linalg.solve(system, (_sweep(scaled, scaling) - scaling)[:, None])[:, 0]
    longest = jnp.max(jnp.where(scaled.demand > 0, jnp.abs(step), 0))
    return jnp.where(jnp.all(jnp.isfinite(step)), step / jnp.maximum(longest / LONGEST_STEP, 1), 0)


def _transitions(scaled: _Scaled, scaling: Float[Array, " columns"]) -> Float[Array, "columns columns"]:
    """The odds that a grain in one column is in another one, after it went back to its row and out again."""
    return _column_shares(scaled, scaling).T @ _row_shares(scaled, scaling)


def _column_shares(scaled: _Scaled, scaling: Float[Array, " columns"]) -> Float[Array, "rows columns"]:
    """Shares of each column's mass by row; for a dead column, those that its first mass would have."""
    return jax.nn.softmax(_columns_log_joint(scaled, scaling), axis=0)


@eqx.filter_custom_jvp
def _with_derivatives(
    arguments: _Arguments, cost: Float[Array, ""], scaling: Float[Array, " columns"], solved: Bool[Array, ""]
) -> Float[Array, ""]:
    """The cost, which was computed from arguments held constant, with its derivatives; 0 where it was not solved."""
    del arguments, scaling, solved
    return cost


@_with_derivatives.def_jvp
def _derivatives(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Array, Array]:
    arguments, cost, scaling, solved = primals
    reason = "sinkhorn has no second derivatives; differentiate once, or take exact_transport"
    scaling = without_derivatives(scaling, arguments, reason)
    moved = jax.tree.map(
        lambda leaf, tangent: jnp.zeros_like(leaf) if tangent is None else tangent,
        arguments,
        _Arguments(*tangents[0]),
    )
    _, tangent = jax.jvp(lambda own: _cost_nearby(own, scaling, solved), (arguments,), (moved,))
    return cost, tangent


@in_full_precision
def _cost_nearby(arguments: _Arguments, scaling: Float[Array, " columns"], solved: Bool[Array, ""]) -> Float[Array, ""]:
    r"""The cost to first order, in which the plan's change is that of the entropic problem's solution.

    Where $\alpha_i + \beta_j$ fits $C_{ij}$ best, by least squares with the plan as weights, the change of $\sum P C$
    with the plan is $\sum \alpha \, \mathrm{d}a + \sum \beta \, \mathrm{d}b - \sum P (C - \alpha - \beta) \,
    \mathrm{d}(C / \epsilon)$: the rest vanishes by the normal equations.
    """
    problem, balanced, _, scaled = _embedded(arguments)
    held, cost = jax.lax.stop_gradient((scaled, balanced.cost))
    shares = jnp.where(solved, _row_shares(held, scaling), 0)
    plan = jax.lax.stop_gradient(balanced.supply)[:, None] * shares
    of_columns = jnp.where(solved, _fitted_columns(held, scaling, cost), 0)
    of_rows = jnp.sum(shares * (cost - of_columns[None]), axis=1)
    even = (jnp.sum(held.demand * of_columns) - jnp.sum(held.supply * of_rows)) / 2
    work = (plan[:-1, :-1] * problem.cost).sum()
    work += jnp.sum((of_rows + even) * _change(balanced.supply)) + jnp.sum(
        (of_columns - even) * _change(balanced.demand)
    )
    work -= jnp.sum(plan * (cost - of_rows[:, None] - of_columns[None]) * _change(scaled.cost))
    return problem.per_flow(work)


def _change(value: Array) -> Array:
    return value - jax.lax.stop_gradient(value)


def _fitted_columns(
    scaled: _Scaled, scaling: Float[Array, " columns"], cost: Float[Array, "rows columns"]
) -> Float[Array, " columns"]:
    r"""$\beta$ of `_cost_nearby`, 0 for the heaviest column: the potentials of a network with the plan as conductances.

    Column after column is eliminated, as Grassmann, Taksar and Heyman do it (Operations Research 33, 1985): nothing is
    subtracted from a diagonal, so that parts of the plan that hardly any mass connects, as between equal mixtures, keep
    their digits.
    """
    order = jnp.argsort(scaled.demand)
    back, out = _column_shares(scaled, scaling)[:, order].T, _row_shares(scaled, scaling)[:, order]
    cost = cost[:, order]
    size = len(order)
    columns = jnp.arange(size)
    odds = back @ out
    # Odds times the difference of the two columns' costs in the row between them.
    gains = (back * cost.T) @ out - back @ (out * cost)

    def without(column: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        odds, gains = state
        left = columns > column
        onward = jnp.where(left, odds[column], 0)
        total = onward.sum()
        into = jnp.where(left, odds[:, column], 0)[:, None] / total
        further = jnp.where(left, gains[column], 0)[None]
        gained = jnp.where(left, gains[:, column], 0)[:, None] / total
        return odds + into * onward[None], gains + gained * onward[None] + into * further

    odds, gains = jax.lax.fori_loop(0, size - 1, without, (odds, gains))

    def fitted(step: Array, potentials: Array) -> Array:
        column = size - 2 - step
        onward = jnp.where(columns > column, odds[column], 0)
        gained = jnp.where(columns > column, gains[column], 0)
        return potentials.at[column].set((onward @ potentials + gained.sum()) / onward.sum())

    potentials = jax.lax.fori_loop(0, size - 1, fitted, varying_as(jnp.zeros_like(scaled.demand), scaled))
    return potentials[jnp.argsort(order)]
