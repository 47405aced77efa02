"""That the benchmarks compare like with like, and that each table's script runs, on sizes that mean nothing."""

import contextlib
import json
import os
import sys

import numpy as np
import pytest

from gmmjax.evaluation import Scores
from tests.benchmarks import (
    accelerator,
    accuracy,
    batch,
    clouds,
    detect_there,
    detections,
    displacements,
    fits,
    gradients,
    harness,
    large_files,
    m3c2,
    peers,
    repeatability,
    transport,
)
from tests.evaluation.scenes import box_pair, source
from tests.pages import bind_arguments

SCRIPTS = {"-P": detect_there, "-m": large_files}


@pytest.fixture(autouse=True)
def programs_are_kept(monkeypatch):
    monkeypatch.setattr(harness.jax, "clear_caches", lambda: None)


class Here:
    """No process is started: scripts and functions run here, and of a command of gmmjax the words are parsed."""

    def __init__(self, monkeypatch, capsys):
        self.monkeypatch, self.capsys = monkeypatch, capsys

    def run(self, words, cores=None, **environment):
        if words[:2] == ["-m", "gmmjax"]:
            bind_arguments(words[2:])
            return harness.Timed(1.0, 1.0, "", 0.1)
        self.monkeypatch.setattr(sys, "argv", words[1:])
        SCRIPTS[words[0]].main()
        return harness.Timed(1.0, 1.0, self.capsys.readouterr().out, 0.1)

    def peak(self, words):
        return self.run(words).memory

    @contextlib.contextmanager
    def worker(self, cores=None, platform=None):
        yield lambda function, *arguments: harness.timed(lambda: function(*arguments))


@pytest.fixture
def in_this_process(monkeypatch, capsys):
    here = Here(monkeypatch, capsys)
    for module in (accelerator, batch, detections, large_files):
        for name in ("run", "peak", "worker"):
            monkeypatch.setattr(module, name, getattr(here, name), raising=False)


@pytest.fixture(scope="module")
def cloud():
    return clouds.gaussian_cloud(400, gaussians=4)


def printed(module, words, monkeypatch, capsys):
    """The rows of the tables that a script prints."""
    monkeypatch.setattr(sys, "argv", [module.__name__, *words])
    module.main()
    lines = capsys.readouterr().out.splitlines()
    return [line.strip("| ").split(" | ") for line in lines if line.startswith("| ") and not line.startswith("| ---")]


def test_what_is_in_the_log_is_not_measured_again(tmp_path):
    path = tmp_path / "log.jsonl"
    assert harness.Log(path).measure({"size": (1, 2)}, lambda: {"cpu": 1.5})["cpu"] == 1.5
    again = harness.Log(path).measure({"size": (1, 2)}, lambda: pytest.fail("measured again"))
    assert again["cpu"] == 1.5 and again["load"] >= 0 and "cores" in again["conditions"]
    assert harness.Log(path).measure({"size": (1, 3)}, lambda: {"cpu": 2.5})["cpu"] == 2.5
    assert [json.loads(line)["cpu"] for line in path.read_text().splitlines()] == [1.5, 2.5]


def test_a_table_is_put_in_its_place_of_a_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("above\n<!-- fits: begin -->\nold\n<!-- fits: end -->\nbelow\n")
    harness.put(page, "fits", harness.table(["a", "b"], [[1, 2]]))
    text = page.read_text()
    assert "| a | b |\n| --- | --- |\n| 1 | 2 |" in text and "old" not in text
    assert text.startswith("above") and text.endswith("below\n")
    with pytest.raises(SystemExit, match="has no place"):
        harness.put(page, "transport", "")


def test_contenders_take_turns_and_the_first_call_does_not_count():
    calls, walls = [], iter([9.0, 1.0, 3.0])
    own = {"a": lambda: calls.append("a"), "b": lambda: calls.append("b") or harness.Timed(next(walls), 0.5, "found")}
    timing = harness.interleaved(own, 2)["b"]
    assert calls == ["a", "b"] * 3
    assert (timing.wall, timing.cpu, timing.compilation, timing.answer) == (2.0, 0.5, 7.0, "found")


def test_a_command_that_fails_ends_the_benchmark():
    assert harness.run(["-c", "print('said')"]).answer == "said\n"
    with pytest.raises(SystemExit, match="failed"):
        harness.run(["-c", "raise SystemExit(3)"])


def test_a_worker_is_another_process_with_the_cores_that_it_may_use():
    with harness.worker(1) as there:
        assert len(there(os.sched_getaffinity, 0).answer) == 1
        assert there(os.getpid).answer != os.getpid()


def test_transport_and_its_peers_agree():
    before = clouds.mixtures(6, 8)
    after = clouds.changed_mixtures(before)
    pairs = peers.live_pairs(before, after)
    ours = transport.distances(before, after, "exact")
    np.testing.assert_allclose(ours, [peers.pot_distance(*pair) for pair in pairs], atol=1e-12)
    removed = transport.removals(before, after)
    for index, pair in enumerate(pairs):
        gone, new = peers.pot_greedy(*pair)
        assert set(np.flatnonzero(removed.disappeared[index])) == set(gone)
        assert set(np.flatnonzero(removed.appeared[index])) == set(new)


def test_the_peers_detection_finds_what_changed(cloud):
    def fit(points, components):
        found = peers.sklearn_fixed(points, components)
        return clouds.as_mixture(found.weights_, found.means_, found.covariances_)

    here, there = cloud[::2], np.concatenate([cloud[1::2], cloud[1:100:2] + 50])
    gone, new = peers.thesis_detection(here, there, 5, fit)
    assert len(gone) == len(here) and new[200:].all()


@pytest.mark.slow
def test_implicit_and_unrolled_gradients_agree_and_are_measured(cloud, monkeypatch):
    ways = gradients.Contenders(cloud, 6)
    implicit = ways.gradient("implicit", 5000)()
    unrolled = ways.gradient("unrolled", 4 * ways.steps)()
    for name in ("noise_floor", "scale", "degrees_of_freedom", "mean_strength"):
        np.testing.assert_allclose(getattr(implicit, name), getattr(unrolled, name), rtol=1e-4, err_msg=name)
    # Of the program that was compiled just now, and of a shorter one.
    assert ways.memory("unrolled", 4 * ways.steps) > 2 * ways.memory("unrolled", ways.steps)

    monkeypatch.setattr(ways, "gradient", lambda kind, steps: lambda: None)
    monkeypatch.setattr(ways, "memory", lambda kind, steps: 1e6 * steps)
    monkeypatch.setattr(gradients, "Contenders", lambda points, most: ways)
    monkeypatch.setattr(gradients, "gaussian_cloud", lambda size: cloud)
    rows = gradients.measured("overlapping", quick=True)["rows"]
    assert len(rows) == 4 and all(len(row) == len(gradients.COLUMNS) - 1 for row in rows)
    assert rows[3][1:] == ["20 MB", "5 MB", "4"]


def test_labels_are_compared_after_their_changes_were_matched():
    own = np.array([0, 0, 0, 1, 1, -1, -1])
    other = np.array([2, 2, 0, 1, -1, -1, 3])
    renumbered = repeatability.matching(own, other, 2, 4)
    np.testing.assert_array_equal(renumbered, [0, 0, -2, 1, -1, -1, -2])


def test_another_way_to_give_a_pair_is_undone_before_labels_are_compared(monkeypatch):
    class Found:
        items = ()

        def __init__(self, before, after):
            self.labels_before, self.labels_after = (np.full(len(cloud), -1) for cloud in (before, after))
            self.probability_before, self.probability_after = before[:, 0], after[:, 0]

    def detected(before, after, mode):
        return displacements.Detected(Found(before, after), [], 0.0)

    monkeypatch.setattr(repeatability, "detected", detected)
    random = np.random.default_rng(0)
    scene = repeatability.Scene(random.normal(size=(7, 3)), random.normal(size=(9, 3)))
    found = {way.name: difference for way, difference in repeatability.measured(scene)}
    for name in ("rows permuted", "exchanged", "exchanged, not registered"):
        assert str(found[name]) == "0; 0"
    assert found["mirrored"].probability > 0


def test_m3c2_is_given_the_same_as_py4dgeo(tmp_path, monkeypatch):
    pytest.importorskip("py4dgeo")
    # It logs to a file in the working directory.
    monkeypatch.chdir(tmp_path)
    for case in (m3c2.Case(4000, 200, 0.8, 2.0), m3c2.Case(4000, 200, 0.8, 3.0, offset=5e6)):
        timings = m3c2.measured(case, 1, {"ours": m3c2.ours, "py4dgeo": m3c2.theirs})
        *_, distance, level, others = m3c2.cells(timings, case.radius)
        assert float(distance) < 1e-6 and float(level) < 1e-6 and others == "0"
        assert np.isfinite(timings["ours"].answer.level_of_detection).mean() > 0.9


def test_the_best_setting_of_a_peer_stands_in_the_table():
    good, bad = (Scores(true_segments=2, segments=segments, found=2, changes=2) for segments in (2, 5))
    lines = [{"scores": {"gmmjax": vars(bad), "c2c: a": vars(bad), "c2c: b": vars(good)}}] * 2
    best = accuracy.best(lines)
    assert list(best) == ["gmmjax", "c2c"] and best["c2c"] == good + good


def test_probabilities_are_held_against_the_truth():
    changes = [[0.95, True]] * 3 + [[0.95, False], [0.15, False]]
    text = accuracy.calibration_table([{"poses": "given", "changes": changes}])
    assert "| given | 0.9 to 1.0 | 4 | 0.950 | 0.750 |" in text and "| given | calibration error | 5 | 0.190 |" in text


@pytest.mark.slow
def test_accuracy(tmp_path, monkeypatch, capsys):
    sources = [source(box_pair(seed), name) for seed, name in enumerate(["changed", "again"])]
    monkeypatch.setattr(accuracy, "held_out_sources", lambda kinds, seeds, poses, points: sources)
    words = ["--kinds", "room", "--poses", "unknown", "--log", str(tmp_path / "log")]
    heading, row, *_ = printed(accuracy, words, monkeypatch, capsys)
    assert tuple(heading) == accuracy.COLUMNS and len(row) == len(heading)
    assert row[:4] == ["room", row[1], "2 of 2", "0"] and row[1].startswith("1.00 / ")
    monkeypatch.setattr(accuracy, "detected", lambda *given: pytest.fail("measured again"))
    assert row in printed(accuracy, words, monkeypatch, capsys)
    heading, row, *_ = printed(accuracy, [*words, "--peers"], monkeypatch, capsys)
    assert {"c2c", "c2c + evidence", "voxels", "voxels + evidence"} <= set(heading)
    assert row[heading.index("c2c")].startswith("1.00 / ")


@pytest.mark.slow
@pytest.mark.parametrize("module", [fits, transport])
def test_ratios(module, monkeypatch, capsys):
    if module is fits:
        pytest.importorskip("gmmx")
    heading, *rows = printed(module, ["--quick"], monkeypatch, capsys)
    assert tuple(heading) == module.COLUMNS
    assert len(rows) >= 5 and all(len(row) == len(module.COLUMNS) for row in rows)


@pytest.mark.slow
def test_costs_of_detections(in_this_process, monkeypatch, capsys):
    monkeypatch.setattr(detections, "LARGEST", 2_000)
    monkeypatch.setattr(detections, "REPEATS", "1")
    words = ["--quick", "--scans", "hall, 2 boxes", "--turns", "1", "--against", str(detections.HERE), "--many", "2"]
    _, *rows = printed(detections, words, monkeypatch, capsys)
    assert [row[2] for row in rows[:2]] == [str(detections.HERE), "this"]
    names = [row[0] for row in rows[2:5]]
    assert names == [
        "gmmjax detect, cold cache",
        "gmmjax detect, warm cache",
        "2 detections in one process, at their end",
    ]
    # Every stage of the progress is one of the table's.
    assert rows[5] == ["scans", *detections.STAGES.values()]
    assert rows[6][0] == "hall, 2 boxes" and all(float(cell.split()[0]) > 0 for cell in rows[6][1:])


def test_batch_runs(in_this_process, monkeypatch, capsys):
    words = ["--kinds", "gaussians", "--pairs", "2", "--turns", "1", "--restarts", "1"]
    _, *rows = printed(batch, words, monkeypatch, capsys)
    assert [row[1] for row in rows] == [batch.ALL, batch.ONE, batch.LOOP]


def test_large_files(in_this_process, tmp_path, monkeypatch, capsys):
    words = ["--folder", str(tmp_path), "--points", "3000", "--endings", ".laz"]
    _, *rows = printed(large_files, words, monkeypatch, capsys)
    assert [row[2] for row in rows] == ["in chunks", "whole", "gmmjax detect"]


@pytest.mark.slow
def test_an_accelerator_is_compared_with_the_cores(in_this_process):
    case = next(case for case in accelerator.cases(quick=True) if case.function is accelerator.transported)
    cells = accelerator.measured(case, "cpu", repeats=1)["cells"]
    assert len(cells) == len(accelerator.COLUMNS) - 2 and cells[-1] == "0 of the distance"
