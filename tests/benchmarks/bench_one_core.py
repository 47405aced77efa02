"""What depends on the cores: the sweep on one of them beside its floor, and restarts on one and two."""

import os

import pytest

from tests.benchmarks import tasks
from tests.benchmarks.bench_fit import a_step
from tests.benchmarks.scenes import gaussian_cloud
from tests.benchmarks.workers import worker


@pytest.mark.benchmark(group="sweep")
def test_sweep_on_one_core(bench, quick):
    """Nanoseconds a point and component in float32, K = 25, in a process that sees one core."""
    points, components = gaussian_cloud(8192 if quick else 32768), tasks.MAX_COMPONENTS
    fused = pytest.importorskip("tests.benchmarks.fused_loop")
    with worker(1) as one:
        timings = bench.compare(
            ours_short=lambda: one(tasks.steps, points, components, 10, "float32"),
            ours_long=lambda: one(tasks.steps, points, components, 90, "float32"),
            floor_short=lambda: one(fused.sweeps, points, components, 10),
            floor_long=lambda: one(fused.sweeps, points, components, 170),
        )
    per_component = 1e9 / (len(points) * components)
    ours, floor = (a_step(timings, name) * per_component for name in ("ours", "floor"))
    bench.row(
        f"EM sweep on one core, a point and component, float32, K = {components}",
        asked=max(0.8, 2 * floor),
        measured=ours,
        unit="ns",
        least=False,
        ours=f"{ours:.2f} ns",
        peer=f"fused loop (numba) {floor:.2f} ns",
    )


@pytest.mark.benchmark(group="restarts")
def test_restarts_on_two_cores(bench, quick):
    """32 restarts in a process that sees one core and in one that sees two: wall seconds."""
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("needs two cores")
    points, number = gaussian_cloud(1000 if quick else 5000), 8 if quick else 32
    with worker(1) as one, worker(2) as two:
        timings = bench.compare(
            one=lambda: one(tasks.restarts, points, number), two=lambda: two(tasks.restarts, points, number)
        )
    single, double = timings["one"].wall, timings["two"].wall
    bench.row(
        f"{number} restarts, wall time: two cores against one",
        asked=1.8,
        measured=single / double,
        unit="x",
        ours=f"{double:.2f} s",
        peer=f"{single:.2f} s",
    )
    bench.curve("cores", f"{number} restarts", [1, 2], [single, double])


@pytest.mark.benchmark(group="restarts")
def test_restarts_against_single_fits(bench, quick):
    """32 restarts in one call against 32 calls: CPU seconds."""
    points, number = gaussian_cloud(1000 if quick else 5000), 8 if quick else 32
    timings = bench.compare(
        together=lambda: tasks.restarts(points, number), one_by_one=lambda: tasks.single_fits(points, number)
    )
    together, alone = timings["together"].cpu / number, timings["one_by_one"].cpu / number
    bench.row(
        f"{number} restarts: CPU time of each against a single fit",
        asked=0.7,
        measured=together / alone,
        unit="x",
        least=False,
        ours=f"{1e3 * together:.1f} ms",
        peer=f"{1e3 * alone:.1f} ms",
    )


@pytest.mark.benchmark(group="restarts")
def test_scaling_in_restarts(bench, quick):
    """CPU and wall seconds of each restart."""
    points = gaussian_cloud(1000 if quick else 5000)
    numbers = (1, 4, 16) if quick else (1, 4, 16, 64, 256)
    timings = bench.compare(
        **{f"r{number}": lambda number=number: tasks.restarts(points, number) for number in numbers}
    )
    for kind in ("cpu", "wall"):
        seconds = [getattr(timings[f"r{number}"], kind) / number for number in numbers]
        bench.curve("restarts", f"{kind} of each", numbers, seconds)
