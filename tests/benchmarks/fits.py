"""Fits of mixtures beside scikit-learn and gmmx: `python -m tests.benchmarks.fits --page docs/benchmarks.md`.

CPU seconds of all threads, the median of interleaved calls, without compilation. All fits have the same noise floor.
scikit-learn's grid fits every K and takes the lowest BIC; gmmx knows float32 only and is given K. A step is the
difference of a long and a short run over that of their steps.
"""

import contextlib
import os
from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np

from gmmjax import FitSettings, Prior, fit_mixture
from gmmjax.clouds import voxel_grid, voxel_size_for
from gmmjax.mixtures import fit_restarts
from tests.benchmarks import peers
from tests.benchmarks.clouds import GAUSSIANS, exact_length, gaussian_cloud, noise_floor
from tests.benchmarks.harness import Timing, interleaved, seconds, tabulate, worker

MAX_COMPONENTS = 25
MAX_VOXELS = 4096
COLUMNS = ("what", "ours", "peer", "peer / ours", "found by ours; by the peer", "load")


def main() -> None:
    tabulate(__doc__, "fits", COLUMNS, CASES)


def one_fit(quick: bool) -> dict[str, Any]:
    """5,000 points, K from 25 down; several clouds, as the number of steps is luck."""
    points, most, seeds, repeats = (600, 10, 1, 1) if quick else (5000, MAX_COMPONENTS, 3, 5)
    clouds = [gaussian_cloud(points, seed) for seed in range(seeds)]
    ways: dict[str, Callable[[np.ndarray], Any]] = {
        "float64": lambda cloud: fit(cloud, "float64", most).mixture.live_part(),
        "float32": lambda cloud: fit(cloud, "float32", most).mixture.live_part(),
        "scikit-learn, grid by BIC": lambda cloud: peers.sklearn_grid(cloud, most),
        "gmmx, K given": lambda cloud: peers.gmmx_fit(cloud, GAUSSIANS)[0],
    }
    calls = {name: lambda way=way: [way(cloud) for cloud in clouds] for name, way in ways.items()}
    timings = interleaved(calls, repeats)
    found = {name: _found(timing.answer, clouds) for name, timing in timings.items()}
    pairs = [("float64", "scikit-learn, grid by BIC"), ("float32", "gmmx, K given")]
    what = f"{seeds} x one fit of {points:,} points"
    return {"rows": [ratio(f"{what}, {own}, {peer}", timings, own, peer, found) for own, peer in pairs]}


def steps(quick: bool) -> dict[str, Any]:
    """One step of EM, K = 25."""
    points, short, long, repeats = (gaussian_cloud(2000), 2, 6, 1) if quick else (gaussian_cloud(20_000), 5, 45, 5)
    ways: dict[str, Callable[[int], int]] = {
        "float64": lambda number: steps_made(points, number, "float64"),
        "float32": lambda number: steps_made(points, number, "float32"),
        "scikit-learn": lambda number: peers.sklearn_steps(points, MAX_COMPONENTS, number),
        "gmmx": lambda number: peers.gmmx_fit(points, MAX_COMPONENTS, number, 0.0)[1],
    }
    lengths = {"short": short, "long": long}
    calls = {(name, length): lambda way=way, n=n: way(n) for name, way in ways.items() for length, n in lengths.items()}
    timings = interleaved(calls, repeats)
    step = {name: _a_step(timings[name, "short"], timings[name, "long"]) for name in ways}
    what = f"one step of EM, K = {MAX_COMPONENTS}, {len(points):,} points"
    pairs = [("float64", "scikit-learn"), ("float32", "gmmx")]
    return {"rows": [row(f"{what}, {own}, {peer}", step[own], step[peer]) for own, peer in pairs]}


def voxels(quick: bool) -> dict[str, Any]:
    """100,000 points by at most 4,096 voxels with their masses and the scatter within, and as they are."""
    points = gaussian_cloud(5_000 if quick else 100_000)
    contenders = {"voxels": lambda: fit_voxels(points), "all points": lambda: fit(points)}
    timings = interleaved(contenders, 1 if quick else 5)
    found = {name: _found([timing.answer.mixture.live_part()], [points]) for name, timing in timings.items()}
    return {"rows": [ratio(f"{len(points):,} points as voxels, all points", timings, "voxels", "all points", found)]}


def cores(quick: bool) -> dict[str, Any]:
    """Wall seconds of 32 restarts on two cores and on one."""
    points, number = (gaussian_cloud(600), 4) if quick else (gaussian_cloud(5000), 32)
    with worker(1) as one, worker(2) as two:
        contenders = {"two": lambda: two(restarts, points, number), "one": lambda: one(restarts, points, number)}
        timings = interleaved(contenders, 1 if quick else 5)
    what = f"{number} restarts on two cores, on one: wall time"
    return {"rows": [row(what, timings["two"].wall, timings["one"].wall)]}


def kernels(quick: bool) -> dict[str, Any]:
    """A fit by the compiled kernels and by plain JAX."""
    points = gaussian_cloud(600 if quick else 5000)
    with worker() as ours:
        ours(os.getpid)
        with _without_kernels(), worker() as plain:
            contenders = {"kernels": lambda: ours(_fit_only, points), "plain": lambda: plain(_fit_only, points)}
            timings = interleaved(contenders, 1 if quick else 5)
    return {"rows": [row("one fit, compiled kernels, plain JAX", timings["kernels"].cpu, timings["plain"].cpu)]}


CASES: dict[str, Callable[[bool], dict[str, Any]]] = {
    "one fit": one_fit,
    "steps": steps,
    "voxels": voxels,
    "cores": cores,
    "kernels": kernels,
}


def fit(points: np.ndarray, precision: str = "float64", max_components: int = MAX_COMPONENTS) -> Any:
    """One fit, with the noise floor that all fits here have."""
    prior, key = Prior.figueiredo_jain(3, noise_floor(points)), jax.random.key(0)
    return fit_mixture(points, key=key, max_components=max_components, prior=prior, precision=precision)


def _fit_only(points: np.ndarray) -> float:
    return float(fit(points).message_length)


def fit_voxels(points: np.ndarray) -> Any:
    """The voxels, and the fit of their means with their numbers of points as masses."""
    grid = voxel_grid(points, voxel_size_for(points, MAX_VOXELS))
    prior = Prior.figueiredo_jain(3, noise_floor(points))
    masses = {"mass": grid.mass, "scatter": grid.scatter(points)}
    return fit_mixture(grid.points, key=jax.random.key(0), **masses, max_components=MAX_COMPONENTS, prior=prior)


def steps_made(points: np.ndarray, max_steps: int, precision: str) -> int:
    """EM steps on a fixed number of components; returns how many were made."""
    settings = FitSettings(min_components=MAX_COMPONENTS, tolerance=0.0, max_steps=max_steps)
    given = {"key": jax.random.key(0), "max_components": MAX_COMPONENTS, "precision": precision}
    return int(fit_mixture(points, **given, settings=settings).steps)


def restarts(points: np.ndarray, number: int) -> Any:
    """All restarts of one call."""
    prior, key = Prior.figueiredo_jain(3, noise_floor(points)), jax.random.key(0)
    return fit_restarts(points, key=key, max_components=MAX_COMPONENTS, prior=prior, restarts=number)


def ratio(what: str, timings: dict[str, Timing], ours: str, peer: str, found: dict[str, str]) -> list[str]:
    """A row by CPU seconds, with what both found."""
    return row(what, timings[ours].cpu, timings[peer].cpu, f"{found[ours]}; {found[peer]}")


def row(what: str, ours: float, peer: float, found: str = "") -> list[str]:
    """A row of the table, but for the load."""
    return [what, seconds(ours), seconds(peer), f"{peer / ours:.3g} x", found]


def _found(mixtures: list[Any], clouds: list[np.ndarray]) -> str:
    """Numbers of components, and the mean of the message lengths, recomputed in float64 on all points."""
    lengths = [exact_length(mixture, cloud) for mixture, cloud in zip(mixtures, clouds, strict=True)]
    return f"K {', '.join(str(len(own.weights)) for own in mixtures)}, {np.mean(lengths):.2f} nats"


def _a_step(short: Timing, long: Timing) -> float:
    return (long.cpu - short.cpu) / (long.answer - short.answer)


@contextlib.contextmanager
def _without_kernels() -> Iterator[None]:
    before = os.environ.get("GMMJAX_NATIVE")
    os.environ["GMMJAX_NATIVE"] = "0"
    try:
        yield
    finally:
        os.environ.pop("GMMJAX_NATIVE")
        if before is not None:
            os.environ["GMMJAX_NATIVE"] = before


if __name__ == "__main__":
    main()
