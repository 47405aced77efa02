"""Many pairs of clouds, each from many random restarts: by what is fastest on this machine."""

import queue
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, PRNGKeyArray

from gmmjax._cores import available_cores
from gmmjax._host import is_traced, to_numpy
from gmmjax._typing import Scalar
from gmmjax.comparison.choices import Kinds, Method, Solver
from gmmjax.comparison.cloud_comparison import planned
from gmmjax.comparison.host_comparison import HostPair, compare_prepared, compile_decision
from gmmjax.comparison.mixture_comparison import Strengths
from gmmjax.comparison.result import AveragedComparison, Comparison, mean_of_restarts
from gmmjax.comparison.traced_comparison import Program, compared
from gmmjax.errors import InputError, warn
from gmmjax.mixtures import FitSettings, Prior, WeightedPoints, stacked
from gmmjax.pair import Pair
from gmmjax.transport import GroundCost

# Comparisons side by side on an accelerator: enough to fill it, few enough for its memory.
SIDE_BY_SIDE = 1024


class ComparedPair(NamedTuple):
    """Result of one of many pairs.

    Attributes:
        pair: its place among the pairs.
        mean: over its restarts.
        restarts: the comparison by each restart, with a leading axis of them.
    """

    pair: int
    mean: AveragedComparison
    restarts: Comparison


def compare_many(
    pairs: Sequence[Sequence[ArrayLike | WeightedPoints]],
    *,
    key: PRNGKeyArray,
    restarts: int = 16,
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
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[ComparedPair]:
    """`compare` for many pairs of any sizes, from many random restarts each, in the order in which they are done.

    On a CPU every core takes one restart after the other from a common queue, so that none waits for the longest; on
    an accelerator pairs of one padded size run side by side. A result does not depend on which others are computed:
    restart r of pair i has the key `jax.random.split(jax.random.split(key, len(pairs))[i], restarts)[r]`. All pairs are
    checked before the first is computed.

    Args:
        pairs: the clouds before and after, as points [n, d] or as `WeightedPoints`.
        key: random key.
        restarts: of each pair.
        prior: as of `compare`, of all pairs, as is all that follows.
        max_components: K_max.
        method: "greedy", "transport" or "joint".
        kinds: what is looked for.
        ground_cost: between components.
        solver: of the earth mover's distances.
        penalty: of "transport".
        epsilon: entropy of the Sinkhorn solver.
        temperature: of a smooth decision.
        settings: how EM runs.
        progress: called after each pair with how many are done, and how many there are.

    Returns:
        An iterator of what was found, NumPy arrays in float64.

    Raises:
        InputError: as `compare`; it says which pair.

    Warns:
        InputWarning: restarts of a pair failed; they are left out of its mean.
    """
    if is_traced(pairs, key, prior):
        raise InputError("compare_many is a host function: call it outside of jit and vmap, where compare can be used")
    if not len(pairs) or restarts < 1:
        raise InputError(f"{len(pairs)} pairs and restarts={restarts}: give at least one of each")
    strengths, program = planned(
        method, kinds, ground_cost, solver, max_components, settings, Strengths(penalty, epsilon, temperature)
    )
    ready = [_ready(index, pair, prior, program) for index, pair in enumerate(pairs)]
    keys = [jax.random.split(own, restarts) for own in jax.random.split(key, len(pairs))]
    on_cpu = jax.default_backend() == "cpu"
    results = (_on_cores if on_cpu else _side_by_side)(ready, keys, prior, strengths, program)
    return _reported(results, len(ready), progress)


def _ready(
    index: int,
    pair: Sequence[ArrayLike | WeightedPoints],
    prior: Prior | None,
    program: Program,
) -> HostPair:
    try:
        before, after = pair
    except (TypeError, ValueError) as error:
        raise InputError(f"pairs[{index}] must be two clouds, before and after") from error
    try:
        clouds = Pair(before, after)
        points = clouds.map(lambda own: own.points if isinstance(own, WeightedPoints) else own)
        mass = clouds.map(lambda own: own.mass if isinstance(own, WeightedPoints) else None)
        return HostPair.of(points, mass, prior, program)
    except InputError as error:
        raise InputError(f"pairs[{index}], {error}") from error


def _reported(
    results: Iterator[tuple[int, Comparison]], count: int, progress: Callable[[int, int], None] | None
) -> Iterator[ComparedPair]:
    for done, (index, comparison) in enumerate(results, 1):
        lost = int(np.sum(comparison.failed))
        if lost:
            warn(f"pairs[{index}]: {lost} of {len(comparison.emd)} restarts failed: {comparison.why_failed()}")
        yield ComparedPair(index, mean_of_restarts(comparison), comparison)
        if progress is not None:
            progress(done, count)


def _on_cores(
    pairs: Sequence[HostPair], keys: Sequence[jax.Array], prior: Prior | None, strengths: Strengths, program: Program
) -> Iterator[tuple[int, Comparison]]:
    """A common queue of all restarts: a core that is done takes the next."""
    done: queue.SimpleQueue[tuple[int, int, Comparison | BaseException]] = queue.SimpleQueue()
    # At once: to index an array of keys takes .1 ms and more.
    of_restarts = [jnp.unstack(own) for own in keys]

    def compute(index: int, restart: int) -> None:
        try:
            key = of_restarts[index][restart]
            done.put((index, restart, compare_prepared(pairs[index], key, prior, strengths, program)))
        except BaseException as error:  # Raised again by the thread that waits for it.
            done.put((index, restart, error))

    parts: list[dict[int, Comparison]] = [{} for _ in pairs]
    pool = ThreadPoolExecutor(available_cores())
    try:
        # While the first core compiles the fit, the second one compiles what follows it.
        pool.submit(compute, 0, 0)
        if available_cores() > 1:
            pool.submit(compile_decision, pairs[0], strengths, program)
        for index, own in enumerate(of_restarts):
            for restart in range(index == 0, len(own)):
                pool.submit(compute, index, restart)
        for _ in range(sum(map(len, keys))):
            index, restart, part = done.get()
            if isinstance(part, BaseException):
                raise part
            parts[index][restart] = part
            if len(parts[index]) == len(keys[index]):
                yield index, stacked([parts[index].pop(restart) for restart in range(len(keys[index]))])
    finally:
        pool.shutdown(cancel_futures=True)


def _side_by_side(
    pairs: Sequence[HostPair], keys: Sequence[jax.Array], prior: Prior | None, strengths: Strengths, program: Program
) -> Iterator[tuple[int, Comparison]]:
    """Pairs of one padded size as one `vmap` over pairs and restarts."""
    sizes = [tuple(own.mass.shape for own in pair.padded) for pair in pairs]
    for size in dict.fromkeys(sizes):
        numbers = [number for number, own in enumerate(sizes) if own == size]
        at_a_time = max(1, SIDE_BY_SIDE // len(keys[0]))
        for start in range(0, len(numbers), at_a_time):
            chunk = numbers[start : start + at_a_time]
            clouds = stacked([(*pairs[number].padded,) for number in chunk])
            with jax.enable_x64(True):
                together = to_numpy(
                    _mapped(
                        clouds[0], clouds[1], jnp.stack([keys[number] for number in chunk]), prior, strengths, program
                    )
                )
            for nth, number in enumerate(chunk):
                own = jax.tree.map(lambda leaf, nth=nth: leaf[nth], together)
                yield number, pairs[number].cut(own)


@eqx.filter_jit
def _mapped(
    before: WeightedPoints,
    after: WeightedPoints,
    keys: jax.Array,
    prior: Prior | None,
    strengths: Strengths,
    program: Program,
) -> Comparison:
    def of_restart(before: WeightedPoints, after: WeightedPoints, key: PRNGKeyArray) -> Comparison:
        return compared(Pair(before, after), key, prior, strengths, program)

    over_restarts = jax.vmap(of_restart, in_axes=(None, None, 0))
    mapped: Comparison = jax.vmap(over_restarts)(before, after, keys)
    return mapped
