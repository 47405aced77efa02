"""M3C2 beside py4dgeo's, in CPU time and figures: `python -m tests.benchmarks.m3c2 --page docs/benchmarks.md`.

A rugged slope of which half has been eroded, at the coordinates of a survey and at its own. Both get the same core
points, normals, radii and depths, and both begin with the bare points: trees are a part of what is timed.
"""

import contextlib
import dataclasses
import logging
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np

from gmmjax.changes import M3C2Distances, M3C2Settings, m3c2_distances
from gmmjax.pair import Pair
from tests.benchmarks.harness import Log, Timing, interleaved, options, put, seconds, table

COLUMNS = (
    *("points", "core points", "radius / depth", "offset", "in a cylinder", "ours", "py4dgeo", "ratio"),
    *("distance", "level of detection", "other counts", "load"),
)
REGISTRATION_ERROR = 0.005


@dataclasses.dataclass(frozen=True)
class Case:
    """What is compared.

    Attributes:
        points: in either cloud.
        core_points: points of the before cloud; or, as many, places halfway between two of them.
        radius: metres.
        depth: metres.
        offset: of the coordinates, metres.
    """

    points: int
    core_points: int
    radius: float
    depth: float
    offset: float = 0.0

    @property
    def cut_evenly(self) -> bool:
        """Whether py4dgeo cuts the cylinder at the core point, whose cloud must not have a point there then."""
        return int(np.ceil(self.depth / self.radius)) % 2 == 0

    def __str__(self) -> str:
        sizes = f"2 x {self.points:,} | {self.core_points:,} | {self.radius:g} / {self.depth:g} m"
        return f"{sizes} | {f'{self.offset:g} m' if self.offset else 'none'}"


CASES = (
    Case(100_000, 100_000, 0.2, 0.5),
    Case(500_000, 50_000, 0.1, 0.25),
    Case(500_000, 50_000, 0.1, 2.0),
    Case(500_000, 50_000, 0.1, 2.0, offset=5e6),
    Case(500_000, 10_000, 0.5, 2.3),
)


def surface(places: np.ndarray) -> np.ndarray:
    """The height of the slope."""
    x, y = places.T
    return np.asarray(0.6 * x + 0.5 * np.sin(1.7 * x + y) + 0.2 * np.cos(4.1 * y))


def slope(points: int, seed: int, eroded: float = 0.0) -> np.ndarray:
    """A slope of 20 m by 20 m, scanned with noise of 1 cm; of one half so much is gone."""
    random = np.random.default_rng(seed)
    places = random.uniform(0, 20, (points, 2))
    heights = surface(places) + random.normal(0, 0.01, points) - np.where(places[:, 0] > 10, eroded, 0)
    return np.column_stack([places, heights])


def normals_of(points: np.ndarray, step: float = 1e-4) -> np.ndarray:
    """Of the slope at some of its points."""
    sides = [
        (surface(points[:, :2] + shift) - surface(points[:, :2] - shift)) / (2 * step) for shift in step * np.eye(2)
    ]
    normals = np.column_stack([-sides[0], -sides[1], np.ones(len(points))])
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def ours(clouds: Pair[np.ndarray], core: np.ndarray, normals: np.ndarray, case: Case) -> M3C2Distances:
    return m3c2_distances(core, normals, clouds, M3C2Settings(case.radius, case.depth), REGISTRATION_ERROR)


def theirs(
    clouds: Pair[np.ndarray], core: np.ndarray, normals: np.ndarray, case: Case
) -> tuple[np.ndarray, np.ndarray]:
    import py4dgeo

    logging.getLogger("py4dgeo").setLevel(logging.ERROR)
    return py4dgeo.M3C2(  # type: ignore[no-any-return]
        epochs=tuple(map(py4dgeo.Epoch, clouds)),
        corepoints=core,
        corepoint_normals=normals,
        cyl_radius=case.radius,
        max_distance=case.depth,
        registration_error=REGISTRATION_ERROR,
    ).run()


def measured(case: Case, repeats: int, contenders: dict[str, Callable[..., Any]]) -> dict[str, Timing]:
    """All of them, in turns."""
    clouds = Pair(slope(case.points, 0), slope(case.points, 1, eroded=0.1))
    core = clouds.before[np.random.default_rng(2).permutation(case.points)[: case.core_points]]
    if case.cut_evenly:
        core = (core + np.roll(core, 1, axis=0)) / 2
        core[:, 2] = surface(core[:, :2])
    given = clouds.map(lambda own: own + case.offset), core + case.offset, normals_of(core), case
    return interleaved({name: lambda run=run: run(*given) for name, run in contenders.items()}, repeats)


def cells(timings: dict[str, Timing], radius: float) -> list[str]:
    """What was measured; the largest differences are those where both count the same points."""
    found, (distance, uncertainty) = timings["ours"].answer, timings["py4dgeo"].answer
    counted = [found.count.before == uncertainty["num_samples1"], found.count.after == uncertainty["num_samples2"]]
    same, pairs = counted[0] & counted[1], [(found.distance, distance)]
    pairs += [(found.level_of_detection, uncertainty["lodetection"])]
    assert all((np.isnan(one) == np.isnan(other))[same].all() for one, other in pairs)
    most = [f"{np.nanmax(np.abs(one - other)[same]) / radius:.0e}" for one, other in pairs]
    times = [seconds(timings[name].cpu) for name in ("ours", "py4dgeo")]
    ratio = f"{timings['py4dgeo'].cpu / timings['ours'].cpu:.1f} x"
    return [f"{np.median(found.count.before):.0f}", *times, ratio, *most, str((~same).sum())]


def main() -> None:
    arguments = options(__doc__).parse_args()
    log, rows, page = Log(arguments.log), [], arguments.page and arguments.page.resolve()
    contenders, repeats = {"ours": ours, "py4dgeo": theirs}, 1 if arguments.quick else 5
    # py4dgeo logs to a file in the working directory.
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for case in (Case(2_000, 200, 0.5, 1.2),) if arguments.quick else CASES:
            line = log.measure(
                {"case": str(case)},
                lambda case=case: {"cells": cells(measured(case, repeats, contenders), case.radius)},
            )
            rows.append([*str(case).split(" | "), *line["cells"], f"{line['load']:.1f}"])
    put(page, "m3c2", table(COLUMNS, rows))


if __name__ == "__main__":
    main()
