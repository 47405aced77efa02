r"""The dual simplex for balanced transportation problems, a batch of them in the minor axis.

A basis of the transportation problem is a spanning tree of its nodes (rows, columns, and here an artificial root column
of no mass). Removing an arc from the tree leaves two parts; the part without the root is the arc's *cut*. Row k of the
inverse of the basis is plus or minus the indicator of cut k (the matrix is totally unimodular), so that one bit a node
holds the inverse exactly, and a pivot is an exclusive or of words. The flow of an arc is what its cut has too much.

The dual simplex keeps the potentials feasible, $u_i + v_j \le c_{ij}$, and drives the flows to be nonnegative. It needs
no first phase: any potentials of the rows, taken as the cost of their arcs to the root, give a feasible star.

Reference: Ahuja, Magnanti and Orlin, "Network Flows" (1993), sections 11.5 to 11.7.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from gmmjax._typing import Array
from gmmjax._varying import varying_as

_WORD = 32


class Tree(eqx.Module):
    """A spanning tree in every lane: one arc a node, since the root has none of its own.

    Attributes:
        cuts: bit k of word w says that node 32 w + k (rows first, then columns) is on the arc's side without the root.
        from_row: whether the arc's row is inside the cut (else its column is).
        cells: the arc as row * (columns + 1) + column; the last column is the root.
        flows: negative while the tree is not yet optimal.
    """

    cuts: tuple[UInt32[Array, "arcs lanes"], ...]
    from_row: Bool[Array, "arcs lanes"]
    cells: Int[Array, "arcs lanes"]
    flows: Float[Array, "arcs lanes"]


class Iterate(eqx.Module):
    """State that a pivot changes."""

    tree: Tree
    row_potentials: Float[Array, "rows lanes"]
    column_potentials: Float[Array, "columns lanes"]
    running: Bool[Array, " lanes"]
    pivots: Int[Array, " lanes"]


def tolerance(dtype: np.dtype) -> float:
    """The deficit of flow, as a share of the total mass, that counts as rounding."""
    return 32 * float(np.finfo(dtype).eps)


def perturbation(dtype: np.dtype) -> float:
    """The size of the tie-breaking noise, as a share of the largest cost."""
    return float(np.finfo(dtype).eps ** 0.7)


def tie_breaking_noise(rows: int, columns: int) -> np.ndarray:
    """Fixed numbers in [0, 1), one a cell, without any pattern that a cycle of cells could cancel.

    They depend on row and column alone, not on how many there are: padding does not change them.
    """
    row = np.arange(1, rows + 1)[:, None]
    column = np.arange(1, columns + 1)[None, :]
    return np.modf(np.abs(np.sin(12.9898 * row + 78.233 * column)) * 43758.5453)[0]


def _words(nodes: np.ndarray, count: int) -> list[np.ndarray]:
    """The bit of each node in each of the words that hold `count` nodes, as columns [nodes, 1]."""
    return [
        np.where(nodes // _WORD == word, np.uint32(1) << (nodes % _WORD).astype(np.uint32), np.uint32(0))[:, None]
        for word in range(-(-count // _WORD))
    ]


def _any_bit(words: list[Array]) -> Bool[Array, "..."]:
    found = words[0]
    for word in words[1:]:
        found = found | word
    return found != 0


def _contains(cuts: tuple[Array, ...], node: Int[Array, " lanes"]) -> Bool[Array, "arcs lanes"]:
    """Mask of the cuts that contain the node; no cut contains the root, whose bit is never set."""
    bit = jnp.uint32(1) << (node % _WORD).astype(jnp.uint32)
    return _any_bit([cut & jnp.where(node // _WORD == word, bit, jnp.uint32(0))[None] for word, cut in enumerate(cuts)])


def star(
    supply: Float[Array, "rows lanes"],
    demand: Float[Array, "columns lanes"],
    cost: Float[Array, "rows columns_and_root lanes"],
) -> Iterate:
    """The dual feasible start: every row hangs on the root, every column on the row where it is cheapest."""
    rows, columns, lanes = supply.shape[0], demand.shape[0], supply.shape[1]
    row_potentials = cost[:, columns]
    reduced = cost[:, :columns] - row_potentials[:, None]
    nearest = jnp.argmin(reduced, axis=0).astype(jnp.int32)
    hangs = nearest[None] == jnp.arange(rows, dtype=jnp.int32)[:, None, None]
    cuts = tuple(
        jnp.concatenate(
            [
                row_bit + jnp.where(hangs, column_bit[None], np.uint32(0)).sum(1, dtype=jnp.uint32),
                jnp.broadcast_to(column_bit, (columns, lanes)),
            ]
        )
        for row_bit, column_bit in zip(
            _words(np.arange(rows), rows + columns),
            _words(np.arange(rows, rows + columns), rows + columns),
            strict=True,
        )
    )
    of_rows = jnp.arange(rows, dtype=jnp.int32) * (columns + 1) + columns
    of_columns = nearest * (columns + 1) + jnp.arange(columns, dtype=jnp.int32)[:, None]
    flows = jnp.concatenate([supply - jnp.where(hangs, demand[None], 0).sum(1), demand])
    tree = Tree(
        cuts=cuts,
        from_row=jnp.broadcast_to(jnp.arange(rows + columns)[:, None] < rows, flows.shape),
        cells=jnp.concatenate([jnp.broadcast_to(of_rows[:, None], (rows, lanes)), of_columns]),
        flows=flows,
    )
    column_potentials = jnp.concatenate([reduced.min(0), jnp.zeros((1, lanes), cost.dtype)])
    running = flows.min(0) < -tolerance(flows.dtype)
    return Iterate(tree, row_potentials, column_potentials, running, jnp.zeros(lanes, jnp.int32))


def _first(where: Bool[Array, "n lanes"]) -> Int[Array, " lanes"]:
    """The index of the first true entry of each lane, n - 1 where there is none."""
    size = where.shape[0]
    index = jnp.arange(size, dtype=jnp.int32)[:, None]
    return jnp.where(where, index, size - 1).min(0)


def _cheapest_crossing(
    cost: Float[Array, "rows columns lanes"],
    row_potentials: Float[Array, "rows lanes"],
    column_potentials: Float[Array, "columns lanes"],
) -> tuple[Int[Array, " lanes"], Int[Array, " lanes"], Float[Array, " lanes"]]:
    """The cell of the least reduced cost, and that cost; a potential of -inf excludes its row or column."""
    over_rows = (cost - row_potentials[:, None]).min(0) - column_potentials
    reduced = over_rows.min(0)
    column = _first(over_rows == reduced[None])
    # Only the column just found is read again: a second pass over all cells would take as long as the first.
    of_column = jnp.take_along_axis(cost, column[None, None], axis=1)[:, 0] - row_potentials
    return _first(of_column == of_column.min(0)[None]), column, reduced


def pivot(cost: Float[Array, "rows columns_and_root lanes"], at: Iterate) -> Iterate:
    """Replace the arc of the most negative flow by the cheapest arc that feeds its cut."""
    rows, with_root, _ = cost.shape
    nodes = rows + with_root - 1
    tree = at.tree
    least = tree.flows.min(0)
    leaving = jnp.arange(nodes, dtype=jnp.int32)[:, None] == _first(tree.flows == least[None])[None]
    cut = [jnp.where(leaving, words, jnp.uint32(0)).sum(0, dtype=jnp.uint32)[None] for words in tree.cuts]
    from_row = (leaving & tree.from_row).any(0)[None]

    rows_inside = _any_bit([c & bit for c, bit in zip(cut, _words(np.arange(rows), nodes), strict=True)])
    # The root's number is `nodes`, beyond every bit that is ever set.
    columns_inside = _any_bit([c & bit for c, bit in zip(cut, _words(np.arange(rows, nodes + 1), nodes), strict=True)])
    row, column, reduced = _cheapest_crossing(
        cost,
        jnp.where(rows_inside != from_row, at.row_potentials, -jnp.inf),
        jnp.where(columns_inside == from_row, at.column_potentials, -jnp.inf),
    )
    moves = at.running & jnp.isfinite(reduced)
    price = jnp.where(moves, jnp.maximum(reduced, 0), 0)[None]
    price = jnp.where(from_row, price, -price)

    has_row, has_column = _contains(tree.cuts, row), _contains(tree.cuts, rows + column)
    on_cycle = (has_row != has_column) & moves[None]
    # A cut within the leaving arc's cut becomes its complement there, and its arc then points the other way.
    within = ~_any_bit([words & ~c for words, c in zip(tree.cuts, cut, strict=True)])
    gain = jnp.where(moves, -least, 0)[None]
    flows = tree.flows + jnp.where(on_cycle, jnp.where(has_row == tree.from_row, -gain, gain), 0)
    replaced = leaving & moves[None]
    flows = jnp.where(replaced, gain, flows)
    return Iterate(
        tree=Tree(
            cuts=tuple(
                jnp.where(on_cycle & ~leaving, words ^ c, words) for words, c in zip(tree.cuts, cut, strict=True)
            ),
            from_row=tree.from_row ^ (on_cycle & within),
            cells=jnp.where(replaced, (row * with_root + column)[None], tree.cells),
            flows=flows,
        ),
        row_potentials=at.row_potentials - jnp.where(rows_inside, price, 0),
        column_potentials=at.column_potentials + jnp.where(columns_inside, price, 0),
        running=moves & (flows.min(0) < -tolerance(flows.dtype)),
        pivots=at.pivots + moves.astype(jnp.int32),
    )


def dual_simplex(
    supply: Float[Array, "rows lanes"],
    demand: Float[Array, "columns lanes"],
    cost: Float[Array, "rows columns lanes"],
    start: Float[Array, "rows lanes"],
    max_pivots: Int[Array, " lanes"],
) -> tuple[
    Float[Array, "rows columns lanes"],
    Float[Array, "rows lanes"],
    Float[Array, "columns lanes"],
    Bool[Array, " lanes"],
    Int[Array, " lanes"],
]:
    """Solve balanced transportation problems, one a lane, to a vertex.

    Ties between costs could make the dual simplex repeat a basis. It therefore pivots on costs to which fixed noise of
    `perturbation` times the largest cost has been added. With it the dual objective rises at every pivot, no basis
    comes twice, and there are finitely many bases; what rounding could still upset is bounded by `max_pivots`. The last
    basis is optimal for costs that differ by at most the noise, hence costs at most (noise x mass) more than the
    optimum: 1.1e-11 of the largest cost in float64, 1.4e-5 in float32, and nothing unless two bases come as close as
    that. Plan and potentials are computed from the last basis with the true costs.

    Args:
        supply: nonnegative masses of the rows, in units where the total is about 1.
        demand: masses of the columns, of the same total up to rounding.
        cost: costs of at most about 1 in absolute value between rows and columns that have mass.
        start: potentials of the rows to start from; any finite values do, good ones save pivots.
        max_pivots: each lane stops after this number of pivots.

    Returns:
        Plan, potentials of rows and columns, whether the plan is optimal, and the pivots taken.
    """
    true_cost = jnp.concatenate([cost, start[:, None]], axis=1)
    rows, with_root, lanes = true_cost.shape
    noise = perturbation(cost.dtype) * tie_breaking_noise(rows, with_root)
    pivoting_cost = true_cost + jnp.asarray(noise, cost.dtype)[:, :, None]

    def unfinished(at: Iterate) -> Bool[Array, ""]:
        return jnp.any(at.running)

    def step(at: Iterate) -> Iterate:
        after = pivot(pivoting_cost, at)
        return _stopped(after, after.pivots >= max_pivots)

    first = star(supply, demand, pivoting_cost)
    first = varying_as(_stopped(first, max_pivots <= 0), supply, demand, cost, start)
    last = jax.lax.while_loop(unfinished, step, first)
    flows, row_potentials, column_potentials = _basic_solution(last.tree, supply, demand, true_cost)
    plan = jnp.zeros((rows * with_root, lanes), cost.dtype)
    plan = plan.at[last.tree.cells, jnp.arange(lanes)[None]].add(jnp.maximum(flows, 0), unique_indices=True)
    optimal = last.tree.flows.min(0) >= -tolerance(flows.dtype)
    return plan.reshape(rows, with_root, lanes)[:, :-1], row_potentials, column_potentials, optimal, last.pivots


def _stopped(at: Iterate, where: Bool[Array, " lanes"]) -> Iterate:
    stopped: Iterate = eqx.tree_at(lambda it: it.running, at, at.running & ~where)
    return stopped


def _basic_solution(
    tree: Tree,
    supply: Float[Array, "rows lanes"],
    demand: Float[Array, "columns lanes"],
    cost: Float[Array, "rows columns_and_root lanes"],
) -> tuple[Float[Array, "arcs lanes"], Float[Array, "rows lanes"], Float[Array, "columns lanes"]]:
    """Flows and potentials of a tree, afresh from masses and costs: no rounding of earlier pivots is left in them."""
    rows, with_root, lanes = cost.shape
    nodes = rows + with_root - 1
    inside = _any_bit(
        [words[:, None] & bit[None] for words, bit in zip(tree.cuts, _words(np.arange(nodes), nodes), strict=True)]
    )
    surplus = jnp.where(inside, jnp.concatenate([supply, -demand])[None], 0).sum(1)
    arc_cost = jnp.take_along_axis(cost.reshape(rows * with_root, lanes), tree.cells, axis=0)
    price = jnp.where(inside, jnp.where(tree.from_row, arc_cost, -arc_cost)[:, None], 0).sum(0)
    return jnp.where(tree.from_row, surplus, -surplus), price[:rows], -price[rows:]
