"""The thesis's detection, end to end: sixteen restarts of ours against one run of its algorithm on NumPy and POT."""

import numpy as np
import pytest

from gmmjax import detect_changes
from tests.benchmarks import peers, tasks
from tests.benchmarks.scenes import changed_pair


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
