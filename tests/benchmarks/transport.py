"""Exact and entropic distances and Algorithm 1 beside POT and ott-jax: `python -m tests.benchmarks.transport`.

CPU seconds a problem in float64, the median of interleaved calls, without compilation. Costs are computed by all: POT's
by SciPy's `cdist`, which is faster than `ot.dist`. Sinkhorn runs until 1e-6 of the mass is in the wrong place.
"""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from gmmjax import earth_movers_distance
from gmmjax.comparison import remove_changed
from tests.benchmarks import peers
from tests.benchmarks.clouds import changed_mixtures, mixtures
from tests.benchmarks.harness import interleaved, seconds, tabulate

COLUMNS = ("what", "ours", "peer", "peer / ours", "difference", "load")
EPSILON = 0.1


def main() -> None:
    tabulate(__doc__, "transport", COLUMNS, CASES)


def exact(components: int, quick: bool) -> dict[str, Any]:
    """A batch of 1,000."""
    count = 20 if quick else 1000
    stacks = mixtures(count, components), mixtures(count, components, seed=1)
    pairs = peers.live_pairs(*stacks)
    contenders = {
        "ours": lambda: distances(*stacks, "exact"),
        "POT": lambda: [peers.pot_distance(*pair) for pair in pairs],
    }
    timings = interleaved(contenders, 1 if quick else 5)
    what = f"exact, {size_of(components)}, batch of {count:,}"
    difference = _difference(timings["ours"].answer, timings["POT"].answer)
    own, peer = (timings[name].cpu / count for name in contenders)
    return {"rows": [row(f"{what}, POT", own, peer, difference)]}


def one_by_one(components: int, quick: bool) -> dict[str, Any]:
    """One call after the other, from NumPy arrays to a number."""
    count = 5 if quick else 200
    stacks = mixtures(count, components), mixtures(count, components, seed=1)
    before, after = ([jax.tree.map(lambda leaf, i=i: leaf[i], own).live_part() for i in range(count)] for own in stacks)
    pairs = peers.live_pairs(*stacks)
    contenders = {
        "ours": lambda: [float(earth_movers_distance(*pair).cost) for pair in zip(before, after, strict=True)],
        "POT": lambda: [peers.pot_distance(*pair) for pair in pairs],
    }
    timings = interleaved(contenders, 1 if quick else 5)
    difference = _difference(timings["ours"].answer, timings["POT"].answer)
    own, peer = (timings[name].cpu / count for name in contenders)
    return {"rows": [row(f"exact, {size_of(components)}, one by one, POT", own, peer, difference)]}


def entropic(components: int, quick: bool) -> dict[str, Any]:
    """A batch of 256; the entropy is some 5 % of the mean cost."""
    count = 4 if quick else 256
    stacks = mixtures(count, components), mixtures(count, components, seed=1)
    contenders = {
        "ours": lambda: distances(*stacks, "sinkhorn", EPSILON),
        "ott-jax": lambda: peers.ott_distances(*stacks, EPSILON),
    }
    timings = interleaved(contenders, 1 if quick else 5)
    difference = _difference(timings["ours"].answer, timings["ott-jax"].answer)
    own, peer = (timings[name].cpu / count for name in contenders)
    return {"rows": [row(f"Sinkhorn, {size_of(components)}, batch of {count}, ott-jax", own, peer, difference)]}


def removal(components: int, quick: bool) -> dict[str, Any]:
    """Algorithm 1 for pairs of mixtures of which one Gaussian is gone elsewhere; as many as 16 restarts make."""
    count = 4 if quick else 256
    before = mixtures(count, components)
    after = changed_mixtures(before)
    pairs = peers.live_pairs(before, after)
    contenders = {"ours": lambda: removals(before, after), "POT": lambda: [peers.pot_greedy(*pair) for pair in pairs]}
    timings = interleaved(contenders, 1 if quick else 5)
    ours = timings["ours"].answer
    same = [
        set(np.flatnonzero(gone)) == set(theirs[0]) and set(np.flatnonzero(new)) == set(theirs[1])
        for gone, new, theirs in zip(ours.disappeared, ours.appeared, timings["POT"].answer, strict=True)
    ]
    own, peer = (timings[name].cpu / count for name in contenders)
    said = f"{100 * np.mean(same):.0f} % the same removals"
    return {"rows": [row(f"Algorithm 1, {size_of(components)}, {count} pairs, POT", own, peer, said)]}


CASES: dict[str, Callable[[bool], dict[str, Any]]] = {
    "exact, 8": lambda quick: exact(8, quick),
    "exact, 16": lambda quick: exact(16, quick),
    "exact, 25": lambda quick: exact(25, quick),
    "one by one, 25": lambda quick: one_by_one(25, quick),
    "one by one, 100": lambda quick: one_by_one(30 if quick else 100, quick),
    "entropic, 25": lambda quick: entropic(25, quick),
    "removal, 8": lambda quick: removal(8, quick),
    "removal, 25": lambda quick: removal(12 if quick else 25, quick),
}


def distances(before: Any, after: Any, solver: str, epsilon: float | None = None) -> np.ndarray:
    """The distances of two stacks of mixtures, from NumPy arrays to NumPy arrays."""
    with jax.enable_x64(True):
        return np.asarray(_DISTANCES[solver](before, after, epsilon))


def removals(before: Any, after: Any) -> Any:
    """What Algorithm 1 removes in two stacks of mixtures, from NumPy arrays to NumPy arrays."""
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _REMOVALS(before, after))


def _distance(before: Any, after: Any, epsilon: float | None, *, solver: str) -> Any:
    return earth_movers_distance(before, after, solver=solver, epsilon=epsilon).cost


def _batched(solver: str) -> Callable[..., Any]:
    return jax.jit(jax.vmap(lambda *given: _distance(*given, solver=solver), (0, 0, None)))


_DISTANCES = {solver: _batched(solver) for solver in ("exact", "sinkhorn")}
_REMOVALS = jax.jit(jax.vmap(remove_changed))


def size_of(components: int) -> str:
    """The number of components, as `mixtures` has them."""
    return f"K <= {components}" if components <= 16 else f"K = {components}"


def row(what: str, ours: float, peer: float, difference: str) -> list[str]:
    """A row of the table, but for the load."""
    return [what, seconds(ours), seconds(peer), f"{peer / ours:.3g} x", difference]


def _difference(ours: Any, theirs: Any) -> str:
    return f"{np.abs(np.subtract(ours, theirs)).max():.1g}"


if __name__ == "__main__":
    main()
