"""Detection end to end: the thesis's against its algorithm on NumPy and POT, the default's cost, the command line."""

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax import DetectionConfig, detect_changes
from gmmjax.clouds import write_ply
from gmmjax.geometry.rigid import transformed
from tests.benchmarks import peers, tasks
from tests.benchmarks.scenes import changed_pair, hall_pair
from tests.benchmarks.workers import worker


@pytest.mark.benchmark(group="detection")
def test_greedy_detection(bench, quick):
    """Two fits of NumPy's: the tests' plain one, and one that computes nothing twice."""
    before, after = changed_pair(1000 if quick else 5000)
    restarts, most = (4, 12) if quick else (16, tasks.MAX_COMPONENTS)
    timings = bench.compare(
        ours=lambda: detect_changes(before, after, method="greedy", restarts=restarts),
        plain_thesis=lambda: peers.thesis_detection(before, after, most, peers.plain_figueiredo_jain),
        lean_thesis=lambda: peers.thesis_detection(before, after, most, peers.figueiredo_jain),
    )
    for peer in ("plain_thesis", "lean_thesis"):
        what = f"detect_changes, greedy, {restarts} restarts, 2 x {len(before):,} points, against one run of {peer}"
        bench.ratio(what, 20, timings, "ours", peer)
    labels = timings["ours"].answer.labels_before, timings["ours"].answer.labels_after
    changed = {"ours": [int(np.sum(side >= 0)) for side in labels]}
    for peer in ("plain_thesis", "lean_thesis"):
        changed[peer] = [int(side.sum()) for side in timings[peer].answer]
    bench.answers(changed_points_before_and_after=changed)


@pytest.mark.benchmark(group="default detection")
@pytest.mark.parametrize(("size", "seconds", "gigabytes"), [(50_000, 2.0, 1.5), (1_000_000, 20.0, 4.0)])
def test_default_detection(bench, quick, size, seconds, gigabytes):
    """A hall of 30 m in which a box moved, default settings; memory in a new process, compilation included."""
    if quick and size > 50_000:
        pytest.skip("--quick")
    before, after = hall_pair(size)
    timings = bench.compare(ours=lambda: detect_changes(before, after))
    own = timings["ours"].cpu
    what = f"detect_changes, default settings, 2 x {size:,} points"
    bench.row(f"{what}: CPU time", asked=seconds, measured=own, unit="s", least=False, ours=f"{own:.2f} s", peer="")
    with worker(2) as fresh:
        peak = fresh(tasks.detection_memory, size).answer / 1e9
    bench.row(f"{what}: memory", asked=gigabytes, measured=peak, unit="GB", least=False, ours=f"{peak:.2f} GB", peer="")


@pytest.mark.benchmark(group="registration")
@pytest.mark.parametrize(("size", "asked"), [(49_000, 0.3), (100_000, None)])
def test_registration(bench, quick, size, asked):
    """What registration adds to a detection: of scans that lie right, and of displaced ones; the larger has voxels."""
    if quick and size > 49_000:
        pytest.skip("--quick")
    before, after = hall_pair(size)
    displacement = np.eye(4)
    displacement[:3] = np.column_stack([Rotation.from_euler("z", 10, degrees=True).as_matrix(), [0.3, 0.2, 0.1]])
    displaced = transformed(after, displacement)
    timings = bench.compare(
        never=lambda: detect_changes(before, after, config=DetectionConfig(registration="never")),
        registered=lambda: detect_changes(before, after),
        displaced=lambda: detect_changes(before, displaced),
    )
    none = timings["never"].cpu
    for name in ("registered", "displaced"):
        own = timings[name].cpu
        bench.row(f"registration of 2 x {len(before):,} points, {name}: CPU time on top of a detection without it",
                  asked=asked, measured=own - none, unit="s", least=False, ours=f"{own:.2f} s",
                  peer=f"{none:.2f} s without")  # fmt: skip
    bench.answers(changes={name: [len(timing.answer.items)] for name, timing in timings.items()})


@pytest.mark.benchmark(group="command line")
def test_command_line_cold_and_warm(bench, quick, tmp_path):
    """`gmmjax detect` on two PLY files, wall time: the cache of compiled programs empty, and not."""
    files = [tmp_path / f"{name}.ply" for name in ("before", "after")]
    for file, points in zip(files, hall_pair(5_000 if quick else 50_000), strict=True):
        write_ply(file, points)

    def run(cache):
        command = [sys.executable, "-m", "gmmjax", "detect", *map(str, files), "--out", str(tmp_path / "out")]
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / cache)}
        subprocess.run([*command, "--overwrite", "--quiet"], env=environment, check=True)

    def cold():
        cold.runs += 1
        return run(f"cold{cold.runs}")

    cold.runs = 0
    run("warm")
    timings = bench.compare(warm=lambda: run("warm"), cold=cold)
    for name in ("warm", "cold"):
        wall = timings[name].wall
        bench.row(f"gmmjax detect, 2 x 50,000 points, {name} cache: wall time", asked=None, measured=wall, unit="s",
                  least=False, ours=f"{wall:.1f} s", peer="")  # fmt: skip
