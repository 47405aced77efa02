"""Fits, transport and whole detections on a GPU, beside the same calls on the cores of its machine.

`python -m tests.benchmarks.accelerator --page docs/benchmarks.md` writes the table; without `--page` it is printed.

Either has a process of its own, in which JAX has that one platform, and they take turns. What they return is compared,
because sums are in another order on another platform.
"""

import argparse
import itertools
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax
import numpy as np

from gmmjax import detect_changes
from gmmjax.mixtures import map_fits
from tests.benchmarks import tasks
from tests.benchmarks.conftest import seconds
from tests.benchmarks.interleaved import Interleaved, load
from tests.benchmarks.page import put
from tests.benchmarks.scenes import gaussian_cloud, hall_pair, mixtures
from tests.benchmarks.workers import worker

COLUMNS = ("what", "cores", "GPU", "cores / GPU", "compilation, cores", "GPU", "largest difference", "turns", "load")
RESTARTS = 8


class Case(NamedTuple):
    """A row of the table.

    Attributes:
        what: is computed.
        function: returns what is compared.
        arguments: of the function.
        unit: of the difference.
    """

    what: str
    function: Callable[..., np.ndarray]
    arguments: tuple[Any, ...]
    unit: str


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--platform", default="cuda", help="of JAX, beside the CPU")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="small sizes, to try it")
    parser.add_argument("--page", type=Path, help="Markdown file with a place for the table")
    arguments = parser.parse_args()
    rows = ["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
    for case in cases(arguments.quick):
        rows.append(row(case, arguments.platform, arguments.repeats))
        print(rows[-1], file=sys.stderr, flush=True)
    with worker(platform=arguments.platform) as on_platform:
        device = on_platform(device_kind).answer
    put(arguments.page, "accelerator", "\n".join([f"The GPU is {device}.", "", *rows]))


def cases(quick: bool) -> Iterator[Case]:
    """All that is measured."""
    points, clouds, distances = (1_000, (2,), (8,)) if quick else (5_000, (4, 32), (256, 4096))
    for precision, number in itertools.product(("float64", "float32"), clouds):
        what = f"{number} clouds of {points:,} points x {RESTARTS} restarts, {precision}"
        yield Case(what, shortest_lengths, (number, points, precision), "nats of the shortest message length")
    for solver, number in itertools.product(("exact", "sinkhorn"), distances):
        what = f"{number:,} distances of mixtures of {tasks.MAX_COMPONENTS} Gaussians, {solver}"
        yield Case(what, transported, (number, solver), "of the distance")
    size = 2_000 if quick else 20_000
    yield Case(f"detection, 2 x {size:,} points", probabilities, (size,), "of the probability")


def device_kind() -> str:
    """The name of what this process computes on."""
    return str(jax.devices()[0].device_kind)


def shortest_lengths(number: int, points: int, precision: Literal["float64", "float32"]) -> np.ndarray:
    """The shortest message length of each of so many clouds."""
    clouds = [gaussian_cloud(points, seed) for seed in range(number)]
    key = jax.random.key(0)
    fits = map_fits(clouds, key=key, max_components=tasks.MAX_COMPONENTS, restarts=RESTARTS, precision=precision)
    return np.array([np.min(fit.message_length) for fit in fits])


def transported(number: int, solver: str) -> np.ndarray:
    """So many distances, in float64."""
    before, after = (mixtures(number, tasks.MAX_COMPONENTS, seed) for seed in range(2))
    return tasks.batch_of_distances(before, after, solver)


def probabilities(size: int) -> np.ndarray:
    """Of all points of both scans."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = detect_changes(*hall_pair(size))
    return np.concatenate([found.probability_before, found.probability_after])


def row(case: Case, platform: str, repeats: int) -> str:
    """Wall seconds on the cores and on the platform, compilation apart."""
    before = load()
    with worker(platform="cpu") as on_cores, worker(platform=platform) as on_platform:
        turns = Interleaved(
            {
                "cores": lambda: on_cores(case.function, *case.arguments),
                "platform": lambda: on_platform(case.function, *case.arguments),
            }
        )
        for _ in range(repeats + 1):
            turns.turn()
    both = turns.timings["cores"], turns.timings["platform"]
    cells = [
        case.what,
        *(seconds(timing.wall) for timing in both),
        f"{both[0].wall / both[1].wall:.2g} x",
        *(seconds(timing.compilation) for timing in both),
        f"{np.abs(both[0].answer - both[1].answer).max():.1g} {case.unit}",
        *(str(len(both[0].walls)), f"{max(before, load()):.1f}"),
    ]
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
