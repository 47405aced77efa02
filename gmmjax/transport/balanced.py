"""Balanced transport in any unit, with dead components, for one problem or any stack of them."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Bool, Float, Int

from gmmjax._typing import Array
from gmmjax._varying import varying_as
from gmmjax.native import kernel_or
from gmmjax.transport.dual_simplex import dual_simplex

_CPU_LANES = 64
"""Problems that a CPU solves side by side: few enough that their costs stay in its second-level cache (measured)."""

_DEAD_COST = 8.0
"""The cost of a dead component, in units of the largest live one: never a short cut."""

_SMOOTHING = 0.025
"""The entropy of the starting potentials, in units of the largest cost."""

_SWEEPS = 5


class BalancedSolution(NamedTuple):
    """A vertex, its potentials, whether it is optimal, and the pivots that led to it."""

    plan: Float[Array, "*stack rows columns"]
    row_potentials: Float[Array, "*stack rows"]
    column_potentials: Float[Array, "*stack columns"]
    optimal: Bool[Array, "*stack"]
    pivots: Int[Array, "*stack"]


def pivot_limit(rows: int, columns: int) -> int:
    """Pivots that no problem should need: over ten times what the hardest of thousands took."""
    return 50 * (rows + columns + 2)


@jax.jit
def balanced_transport(
    supply: Float[Array, " rows"],
    demand: Float[Array, " columns"],
    cost: Float[Array, "rows columns"],
    start: Float[Array, " columns"],
    max_pivots: Int[Array, ""],
) -> BalancedSolution:
    """Move all of the supply to the demand, of the same total, at the least cost.

    All `jax.vmap`s around a call, nested ones too, make one stack for the solver, so that they cost what a hand-made
    batch costs. The solution is constant to differentiation; `exact_transport` knows its derivatives.

    Args:
        supply: nonnegative and finite, as is `demand`; 0 marks a dead component.
        demand: of the same total, up to rounding.
        cost: finite, in any unit; what it says about dead components only sets their potentials.
        start: potentials of the columns to start from, such as those of a similar problem; infinity for none.
        max_pivots: where to give up.

    Returns:
        The solution. A dead component's potential is the price at which its first grain of mass would travel.
    """
    arguments = jax.lax.stop_gradient((supply, demand, cost, start, max_pivots))
    dtype = jnp.result_type(supply, demand, cost)
    shapes = (
        *(jax.ShapeDtypeStruct(array.shape, dtype) for array in (cost, supply, demand)),
        jax.ShapeDtypeStruct((), jnp.bool_),
        jax.ShapeDtypeStruct((), jnp.int32),
    )
    masses_and_prices = (array.astype(dtype) for array in arguments[:4])
    # By successive shortest paths; see `native/transport_kernel.h`.
    solved = kernel_or("gmmjax_transport", _plain_transport, shapes, *masses_and_prices, arguments[4])
    return BalancedSolution(*varying_as(solved, *arguments[:4]))


def _plain_transport(supply: Array, demand: Array, cost: Array, start: Array, max_pivots: Array) -> BalancedSolution:
    """By the dual simplex, one stack for all axes that `vmap` adds."""
    solved = _solve_stack(supply[None], demand[None], cost[None], start[None], max_pivots[None])
    return BalancedSolution(*(leaf[0] for leaf in solved))


@custom_vmap
def _solve_stack(
    supply: Float[Array, "stack rows"],
    demand: Float[Array, "stack columns"],
    cost: Float[Array, "stack rows columns"],
    start: Float[Array, "stack columns"],
    max_pivots: Int[Array, " stack"],
) -> BalancedSolution:
    arguments = (supply, demand, cost, start, max_pivots)
    size = supply.shape[0]
    if jax.default_backend() != "cpu" or size <= _CPU_LANES:
        return _solve_block(arguments)
    blocks = -(-size // _CPU_LANES)
    lanes = -(-size // blocks)

    def split(leaf: Array) -> Array:
        padded = jnp.pad(leaf, [(0, blocks * lanes - size)] + [(0, 0)] * (leaf.ndim - 1))
        return padded.reshape(blocks, lanes, *leaf.shape[1:])

    solved = jax.lax.map(_solve_block, jax.tree.map(split, arguments))
    joined: BalancedSolution = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[:size], solved)
    return joined


@_solve_stack.def_vmap
def _stack_of_stacks(axis_size: int, in_batched: list[bool], *arguments: Array) -> tuple[BalancedSolution, Any]:
    """Fold the new axis into the stack, which the solver puts into the minor axis."""
    whole = [
        leaf if batched else jnp.broadcast_to(leaf[None], (axis_size, *leaf.shape))
        for leaf, batched in zip(arguments, in_batched, strict=True)
    ]
    solved = _solve_stack(*(leaf.reshape(-1, *leaf.shape[2:]) for leaf in whole))
    unfolded = jax.tree.map(lambda leaf: leaf.reshape(axis_size, -1, *leaf.shape[1:]), solved)
    return unfolded, jax.tree.map(lambda _: True, unfolded)


def _solve_block(arguments: tuple[Array, Array, Array, Array, Array]) -> BalancedSolution:
    """Solve a stack side by side, in units where the total mass and the largest live cost are 1."""
    supply, demand, cost, given = (jnp.moveaxis(leaf, 0, -1) for leaf in arguments[:4])
    live_rows, live_columns = supply > 0, demand > 0
    live = live_rows[:, None] & live_columns[None]
    total = _nonzero(supply.sum(0, keepdims=True))
    unit = _nonzero(jnp.where(live, jnp.abs(cost), 0).max((0, 1)))

    scaled = jnp.where(live, cost, 0) / unit[None, None]
    # The dual simplex starts from rows: from the highest that given columns' potentials allow.
    allowed = _least(scaled - (jnp.where(live_columns, given, 0) / unit[None])[None], live_columns[None], axis=1)
    smooth = _smooth_potentials(supply / total, demand / total, scaled, live)
    start = jnp.where(live_rows, jnp.where(jnp.isfinite(given).all(0, keepdims=True), allowed, smooth), 0)
    # A dead column hangs on the last row, a dead row on the root; their other arcs are too dear to be short cuts.
    last_row = (jnp.arange(supply.shape[0]) == supply.shape[0] - 1)[:, None, None]
    pivoting = jnp.where(live, scaled, jnp.where(last_row & ~live_columns[None], 0, _DEAD_COST))
    plan, rows, columns, optimal, pivots = dual_simplex(
        supply / total, demand / total, pivoting.astype(cost.dtype), start, arguments[4]
    )
    rows, columns = rows * unit[None], columns * unit[None]
    solution = BalancedSolution(
        plan=jnp.where(live, plan, 0) * total[None],
        row_potentials=jnp.where(live_rows, rows, _least(cost - columns[None], live_columns[None], axis=1)),
        column_potentials=jnp.where(live_columns, columns, _least(cost - rows[:, None], live_rows[:, None], axis=0)),
        optimal=optimal,
        pivots=pivots,
    )
    moved: BalancedSolution = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0), solution)
    return moved


def _nonzero(scale: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    return jnp.where(scale > 0, scale, 1)


def _least(
    values: Float[Array, "rows columns lanes"], allowed: Bool[Array, "..."], axis: int
) -> Float[Array, "n lanes"]:
    """The least allowed value along an axis, 0 where none is allowed."""
    least = jnp.where(allowed, values, jnp.inf).min(axis)
    return jnp.where(jnp.isfinite(least), least, 0)


def _smooth_potentials(
    supply: Float[Array, "rows lanes"],
    demand: Float[Array, "columns lanes"],
    cost: Float[Array, "rows columns lanes"],
    live: Bool[Array, "rows columns lanes"],
) -> Float[Array, "rows lanes"]:
    """Row potentials after a few Sinkhorn sweeps: a start that halves the pivots of the zero start (measured).

    Any finite numbers would do for a start, so single precision is enough.
    """
    kernel = jnp.where(live, jnp.exp(-cost.astype(jnp.float32) / _SMOOTHING), 0)
    row_mass, column_mass = supply.astype(jnp.float32), demand.astype(jnp.float32)
    column_scaling: Array = jnp.ones_like(column_mass)
    for _ in range(_SWEEPS):
        row_scaling = row_mass / jnp.maximum((kernel * column_scaling[None]).sum(1), 1e-18)
        column_scaling = column_mass / jnp.maximum((kernel * row_scaling[:, None]).sum(0), 1e-18)
    row_scaling = row_mass / jnp.maximum((kernel * column_scaling[None]).sum(1), 1e-18)
    return (_SMOOTHING * jnp.log(jnp.maximum(row_scaling, 1e-18))).astype(cost.dtype)
