"""Pairs an hour of `compare_many`, of `detect_many`, of one `vmap`, and of a loop over scikit-learn and POT.

`python -m tests.benchmarks.compared_pairs --log compared.jsonl` prints a Markdown table.

All contenders compare the same pairs of 2 x 2,000 points of five Gaussians, of which one goes and another comes, each
in a new process, in turns. Seconds to the first result count from the start of the process, with all imports and
compilation; the others are those of a second call. A line of the log is written for each run: what is in the log is not
measured again.
"""

import argparse
import functools
import itertools
import json
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.harness import Line, Log, cpu_seconds, options, put, run, table

GAUSSIANS, POINTS = 5, 2_000
METHODS = ("greedy", "transport", "joint")
MANY, CACHED, DETECT, VMAP, PEERS = (
    "compare_many",
    "compare_many, programs on disk",
    "detect_many",
    "jit(vmap(vmap(compare)))",
    "scikit-learn and POT, K given",
)
CONTENDERS = (MANY, CACHED, DETECT, VMAP, PEERS)
COLUMNS = (
    *("contender", "method", "pairs x restarts", "runs", "first result", "CPU until then", "wall a comparison"),
    *("CPU a comparison", "pairs x 64 restarts an hour", "load"),
)


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--contenders", nargs="+", choices=CONTENDERS, default=[*CONTENDERS])
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=[*METHODS])
    parser.add_argument("--size", default="64x64", help="pairs x restarts")
    parser.add_argument("--part", default="4x8", help="the same of the loop over the peers, which takes long")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--run", nargs=2, metavar=("CONTENDER", "METHOD"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.run is not None:
        print(json.dumps(measured(*arguments.run, arguments.size, arguments.log)))
        return
    log, lines = Log(arguments.log), []
    for turn, contender in itertools.product(range(arguments.turns), arguments.contenders):
        size = arguments.part if contender == PEERS else arguments.size
        # Algorithm 1 is the only method that the peers' loop has.
        for method in ["greedy"] if contender == PEERS else arguments.methods:
            key = {"contender": contender, "method": method, "size": size, "turn": turn}
            given = contender, method, size, arguments.log
            lines.append(log.measure(key, lambda given=given: in_new_process(*given)))
    put(arguments.page, "compared pairs", compared_table(lines))


def in_new_process(contender: str, method: str, size: str, log: Path | None) -> dict[str, Any]:
    """Runs a contender; seconds to its results count from the start of the process."""
    words = ["-m", "tests.benchmarks.compared_pairs", "--run", contender, method, "--size", size]
    began = time.time()
    done = run([*words, *(["--log", str(log)] if log else [])], JAX_PLATFORMS="cpu")
    found = json.loads(done.answer)
    return {**found, "cpu": done.cpu, "finished": [own - began for own in found["finished"]]}


def measured(contender: str, method: str, size: str, log: Path | None) -> dict[str, Any]:
    """One contender in this process: when each pair was done, and wall and CPU seconds of a second call.

    `detect_many` starts new processes in each call: a second one would have the start again.
    """
    pairs, restarts = (int(number) for number in size.split("x"))
    call = functools.partial(CALLS[contender], method, scenes(pairs), restarts, log)
    finished, spent = [], []
    for _ in call():
        finished.append(time.time())
        spent.append(cpu_seconds())
    if contender == DETECT:
        # Of its processes, which have not ended, nothing is known.
        return {"finished": finished, "first_cpu": None, "again": None}
    wall, cpu = time.perf_counter(), cpu_seconds()
    for _ in call():
        pass
    return {"finished": finished, "first_cpu": spent[0], "again": [time.perf_counter() - wall, cpu_seconds() - cpu]}


def scenes(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Clouds of five Gaussians, of which one goes and another comes, drawn by NumPy: quickly, and without JAX."""
    pairs = []
    for seed in range(count):
        random = np.random.default_rng(seed)
        means = random.uniform(-3, 3, (GAUSSIANS + 1, 3))
        factors = random.normal(size=(GAUSSIANS + 1, 3, 3)) * 0.4 + 0.3 * np.eye(3)
        parts = (np.arange(GAUSSIANS), np.arange(1, GAUSSIANS + 1))
        pairs.append(tuple(_drawn(random, means[own], factors[own]) for own in parts))
    return pairs


def _drawn(random: np.random.Generator, means: np.ndarray, factors: np.ndarray) -> np.ndarray:
    standard = random.normal(size=(len(means), POINTS // len(means), 3))
    return (means[:, None] + np.einsum("kij,knj->kni", factors, standard)).reshape(-1, 3)


Scenes = list[tuple[np.ndarray, np.ndarray]]


def by_compare_many(method: str, pairs: Scenes, restarts: int, log: Path | None, cached: bool = False) -> Iterator[Any]:
    """A result for each pair."""
    import jax

    from gmmjax import use_compilation_cache
    from gmmjax.comparison import compare_many

    if cached:
        use_compilation_cache((log or Path("compared_pairs")).with_suffix(".programs"))
    yield from compare_many(pairs, key=jax.random.key(0), restarts=restarts, method=method)


def by_detect_many(method: str, pairs: Scenes, restarts: int, log: Path | None) -> Iterator[Any]:
    """Without registration and filters, which `compare` has not; every restart with every other, r x r."""
    from gmmjax.batch import BatchPair, detect_many
    from gmmjax.changes import DetectionConfig

    config = DetectionConfig(
        method=method, restarts=restarts, max_components=25, registration="never", outlier_neighbours=0
    )
    yield from detect_many([BatchPair(f"pair {n}", *pair) for n, pair in enumerate(pairs)], config=config)


def by_vmap(method: str, pairs: Scenes, restarts: int, log: Path | None) -> Iterator[Any]:
    """All pairs and restarts as one program: all results at once."""
    import jax

    with jax.enable_x64(True):
        keys = jax.vmap(lambda key: jax.random.split(key, restarts))(jax.random.split(jax.random.key(0), len(pairs)))
        clouds = [np.stack(side) for side in zip(*pairs, strict=True)]
        yield from np.asarray(program(method)(*clouds, keys).emd)


@functools.cache
def program(method: str) -> Callable[..., Any]:
    """`jit(vmap(vmap(compare)))`, averaged over the restarts."""
    import jax

    from gmmjax.comparison import averaged, compare

    def of_restart(before: Any, after: Any, key: Any) -> Any:
        return compare(before, after, key=key, method=method)

    of_pair = jax.vmap(of_restart, in_axes=(None, None, 0))
    return jax.jit(lambda *given: jax.vmap(averaged)(jax.vmap(of_pair)(*given)))


def by_peers(method: str, pairs: Scenes, restarts: int, log: Path | None) -> Iterator[Any]:
    """Two fits of scikit-learn's with the true number of Gaussians, Algorithm 1 on POT, and the changed points."""
    from threadpoolctl import threadpool_limits

    from tests.benchmarks.clouds import as_mixture
    from tests.benchmarks.peers import sklearn_fixed, thesis_detection

    def fit(points: np.ndarray, components: int, seed: int) -> Any:
        found = sklearn_fixed(points, components, seed)
        return as_mixture(found.weights_, found.means_, found.covariances_)

    for before, after in pairs:
        with threadpool_limits(1):
            of_seeds = [functools.partial(fit, seed=seed) for seed in range(restarts)]
            yield [thesis_detection(before, after, GAUSSIANS, of_seed) for of_seed in of_seeds]


CALLS: dict[str, Callable[..., Iterator[Any]]] = {
    MANY: by_compare_many,
    CACHED: functools.partial(by_compare_many, cached=True),
    DETECT: by_detect_many,
    VMAP: by_vmap,
    PEERS: by_peers,
}


def compared_table(lines: Sequence[Line]) -> str:
    """A row for each contender, method and size: medians over the turns."""
    rows = []
    groups: dict[tuple[str, str, str], list[Line]] = {}
    for line in lines:
        groups.setdefault((line["size"], line["method"], line["contender"]), []).append(line)
    for (size, method, contender), group in sorted(groups.items()):
        restarts = int(size.split("x")[1])
        # The first run fills the folder of programs.
        counted = group[1:] if contender == CACHED and len(group) > 1 else group
        first = statistics.median(line["finished"][0] for line in counted)
        wall, cpu = (statistics.median(steady(line)[part] for line in counted) / restarts for part in (0, 1))
        until = [line["first_cpu"] for line in counted if line["first_cpu"] is not None]
        cells = [contender, method, size.replace("x", " x "), str(len(counted)), f"{first:.1f} s"]
        cells.append(f"{statistics.median(until):.1f} s" if until else "")
        cells += [f"{1e3 * wall:.1f} ms", f"{1e3 * cpu:.1f} ms", f"{3600 / wall / 64:,.0f}"]
        rows.append([*cells, f"{max(line['load'] for line in counted):.1f}"])
    return table(COLUMNS, rows)


def steady(line: Line) -> tuple[float, float]:
    """Wall and CPU seconds a pair without start and compilation; of `detect_many` the CPU seconds are those of all."""
    finished = line["finished"]
    if line["again"] is None:
        return (finished[-1] - finished[0]) / max(1, len(finished) - 1), line["cpu"] / len(finished)
    return line["again"][0] / len(finished), line["again"][1] / len(finished)


if __name__ == "__main__":
    main()
