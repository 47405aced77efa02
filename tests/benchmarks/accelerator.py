"""Fits, transport and whole detections on a GPU, beside the same calls on the cores of its machine.

`python -m tests.benchmarks.accelerator --page docs/benchmarks.md` writes the table; without `--page` it is printed.

Either has a process of its own, in which JAX has that one platform, and they take turns. What they return is compared,
because sums are in another order on another platform.
"""

import itertools
import sys
import warnings
from collections.abc import Callable, Iterator
from typing import Any, Literal, NamedTuple

import jax
import numpy as np

from gmmjax import detect_changes
from gmmjax.mixtures import map_fits
from tests.benchmarks.clouds import gaussian_cloud, hall_pair, mixtures
from tests.benchmarks.fits import MAX_COMPONENTS
from tests.benchmarks.harness import Log, interleaved, options, put, seconds, table, worker
from tests.benchmarks.transport import distances

COLUMNS = ("what", "cores", "GPU", "cores / GPU", "compilation, cores", "GPU", "largest difference", "load")
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
    parser = options(__doc__)
    parser.add_argument("--platform", default="cuda", help="of JAX, beside the CPU")
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    log, rows = Log(arguments.log), []
    for case in cases(arguments.quick):
        line = log.measure({"what": case.what}, lambda own=case: measured(own, arguments.platform, arguments.repeats))
        rows.append([case.what, *line["cells"], f"{line['load']:.1f}"])
        print(rows[-1], file=sys.stderr, flush=True)
    with worker(platform=arguments.platform) as on_platform:
        device = on_platform(device_kind).answer
    put(arguments.page, "accelerator", f"The GPU is {device}.\n\n{table(COLUMNS, rows)}")


def cases(quick: bool) -> Iterator[Case]:
    """All that is measured."""
    points, clouds, distances = (1_000, (2,), (8,)) if quick else (5_000, (4, 32), (256, 4096))
    for precision, number in itertools.product(("float64", "float32"), clouds):
        what = f"{number} clouds of {points:,} points x {RESTARTS} restarts, {precision}"
        yield Case(what, shortest_lengths, (number, points, precision), "nats of the shortest message length")
    for solver, number in itertools.product(("exact", "sinkhorn"), distances):
        what = f"{number:,} distances of mixtures of {MAX_COMPONENTS} Gaussians, {solver}"
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
    fits = map_fits(clouds, key=key, max_components=MAX_COMPONENTS, restarts=RESTARTS, precision=precision)
    return np.array([np.min(fit.message_length) for fit in fits])


def transported(number: int, solver: str) -> np.ndarray:
    """So many distances, in float64."""
    before, after = (mixtures(number, MAX_COMPONENTS, seed) for seed in range(2))
    return distances(before, after, solver)


def probabilities(size: int) -> np.ndarray:
    """Of all points of both scans."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = detect_changes(*hall_pair(size))
    return np.concatenate([found.probability_before, found.probability_after])


def measured(case: Case, platform: str, repeats: int) -> dict[str, Any]:
    """Wall seconds on the cores and on the platform, compilation apart, and the largest difference."""
    with worker(platform="cpu") as on_cores, worker(platform=platform) as on_platform:
        ways = {"cores": on_cores, "platform": on_platform}
        timings = interleaved(
            {name: lambda way=way: way(case.function, *case.arguments) for name, way in ways.items()}, repeats
        )
    both = timings["cores"], timings["platform"]
    cells = [*(seconds(own.wall) for own in both), f"{both[0].wall / both[1].wall:.2g} x"]
    cells += [seconds(own.compilation) for own in both]
    return {"cells": [*cells, f"{np.abs(both[0].answer - both[1].answer).max():.1g} {case.unit}"]}


if __name__ == "__main__":
    main()
