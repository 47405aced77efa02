"""That the benchmarks of batch runs measure what they say, on made-up numbers and pairs that are not computed."""

import dataclasses
import itertools
import json
import os
import pickle
import subprocess
import sys

import jax
import numpy as np
import pytest

from gmmjax.batch.driver import results_of
from gmmjax.clouds import read_cloud
from tests.benchmarks import batch_ceiling, batch_compare, batch_mapping, batch_memory, batch_pairs, mapped_work, page
from tests.benchmarks.batch_compare import ALL_CORES, LOOP, ONE_CORE, WARM_UP, WHOLE


def measured(contender, turn=0, *, kind="rooms", workers=1, start=5.0, seconds=2.0, pairs=20):
    """A run of pairs that take the same time each, in which nothing but the start is not detection."""
    finished = [start + seconds * (1 + number // workers) for number in range(pairs)]
    zeros, detection = [0.0] * pairs, [seconds] * pairs
    parts = {"detection": detection, "reading": zeros, "writing": zeros}
    return batch_compare.Measured(
        kind, turn, contender, workers, pairs, finished[-1], 40.0, finished, load=[0.0, 0.5], **parts
    )


def test_the_start_of_a_run_is_told_from_its_steady_rate():
    one, both = measured(ONE_CORE), measured(ALL_CORES, workers=2)
    assert (one.steady, one.start) == pytest.approx((2.0, 5.0))
    assert (both.steady, both.start) == pytest.approx((1.0, 5.0))
    assert one.not_detection == pytest.approx(5 / 45)
    assert both.not_detection == pytest.approx(5 / 25)
    assert both.not_detection_when_steady == pytest.approx(0)


def test_what_was_asked_is_reckoned_for_200_pairs():
    lines = [measured(ALL_CORES, WARM_UP, workers=2, start=90.0)]
    lines += [measured(ONE_CORE, turn) for turn in range(3)]
    lines += [measured(ALL_CORES, turn, workers=2) for turn in range(3)]
    lines += [measured(LOOP, turn, start=0.0, seconds=7.0) for turn in range(3)]
    lines += [measured(ALL_CORES, WHOLE, workers=2, pairs=200)]
    assert batch_compare.of_many(lines[1:], ONE_CORE) == pytest.approx(405)
    text = batch_compare.verdicts(lines)
    assert "| rooms | 200 pairs, all cores against batch, one core | ≥ 1.8 x | 1.98 x | yes |" in text
    assert "| rooms | 200 pairs, all cores against loop over detect | ≥ 6.0 x | 6.83 x | yes |" in text
    assert "| rooms | 200 pairs in one run: share of time that is not detection | ≤ 5% | 2.4% | yes |" in text
    table = batch_compare.table(lines).splitlines()
    assert len({line.count("|") for line in table}) == 1
    # The warm-up is in none of them.
    assert [line.split(" | ")[2] for line in table[2:]] == ["3 x 20", "1 x 200", "3 x 20", "3 x 20"]


def test_a_comparison_goes_on_where_it_was(tmp_path, monkeypatch):
    manifest = tmp_path / "rooms" / "manifest.csv"
    manifest.parent.mkdir()
    batch_pairs.write_manifest(manifest, [[f"pair {number}", "a.ply", "b.ply"] for number in range(4)])
    called = []

    def timed(kind, turn, contender, pairs, folder, restarts):
        called.append((turn, contender, [name for name, *_ in pairs]))
        assert not any(folder.iterdir())
        return measured(contender, turn, kind=kind, pairs=max(3, len(pairs)))

    monkeypatch.setattr(batch_compare, "timed", timed)
    log, settings = tmp_path / "log", {"chunk": 2, "turns": 2, "restarts": 16, "contenders": [ALL_CORES, LOOP]}
    batch_compare.measure(manifest, log, tmp_path / "scratch", **settings)
    everything, odd, even = [f"pair {number}" for number in range(4)], ["pair 2", "pair 3"], ["pair 0", "pair 1"]
    plan = [(WARM_UP, ALL_CORES, everything), (0, ALL_CORES, even), (0, LOOP, even), (1, LOOP, odd)]
    assert called == [*plan, (1, ALL_CORES, odd), (WHOLE, ALL_CORES, everything)]
    log.write_text("\n".join(log.read_text().splitlines()[:3]) + "\n")
    called.clear()
    lines = batch_compare.measure(manifest, log, tmp_path / "scratch", **settings)
    assert [turn for turn, *_ in called] == [1, 1, WHOLE]
    assert len(lines) == 6


def test_a_table_takes_its_place_in_the_page(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(page, "conditions", lambda: "A machine.")
    file = tmp_path / "page.md"
    file.write_text("Above.\n\n<!-- one: begin -->\nold\n<!-- one: end -->\n<!-- two: begin --><!-- two: end -->\n")
    for text in ("| first |", "| second |"):
        page.put(file, "one", text)
    page.put(file, "two", "other")
    assert file.read_text() == (
        "Above.\n\n<!-- one: begin -->\n\nA machine.\n\n| second |\n\n<!-- one: end -->\n"
        "<!-- two: begin -->\n\nA machine.\n\nother\n\n<!-- two: end -->\n"
    )
    with pytest.raises(SystemExit, match="three: begin"):
        page.put(file, "three", "")
    page.put(None, "one", "printed")
    assert capsys.readouterr().out == "A machine.\n\nprinted\n"


def test_pairs_are_written_once(tmp_path):
    manifest = batch_pairs.write_pairs(tmp_path, "gaussians", 2)
    names, *files = zip(*batch_pairs.read_manifest(manifest), strict=True)
    assert names == ("gaussians-0000", "gaussians-0001")
    for file, cloud in zip([side[0] for side in files], batch_pairs.gaussians(0), strict=True):
        np.testing.assert_array_equal(read_cloud(file).points, cloud)
    times = [os.stat(side[1]).st_mtime_ns for side in files]
    batch_pairs.write_pairs(tmp_path, "gaussians", 2)
    assert [os.stat(side[1]).st_mtime_ns for side in files] == times


def test_the_driver_hands_out_all_pairs_where_nothing_is_computed():
    tasks = (batch_ceiling.task(number) for number in range(50))
    pool = batch_ceiling.FullPool(1)
    names = [result.name for result in results_of(tasks, pool, batch_ceiling.empty_work, largest_chunk=4)]
    assert names == [f"station-{number:05}" for number in range(50)]
    # Of a pool that holds back as many as it may.
    endless = results_of(map(batch_ceiling.task, itertools.count()), batch_ceiling.FullPool(8), batch_ceiling.no_work)
    assert len({result.name for result in itertools.islice(endless, 100)}) == 100


def test_an_empty_record_is_one_that_can_be_read(tmp_path):
    record = batch_ceiling.record(batch_ceiling.task(3))
    record.write(tmp_path / "pair.json")
    assert dataclasses.asdict(type(record).read(tmp_path / "pair.json")) == dataclasses.asdict(record)
    assert batch_ceiling.pickled(record) == len(pickle.dumps(record, protocol=5))


def test_the_memory_of_what_a_run_started_is_sampled(tmp_path, monkeypatch):
    sleeping = [sys.executable, "-c", "import time; print(flush=True); time.sleep(60)"]
    child = subprocess.Popen(sleeping, stdout=subprocess.PIPE)
    try:
        assert child.stdout is not None and child.stdout.readline()
        assert batch_memory.processes(os.getpid())[child.pid] == "worker"
        assert batch_memory.processes(os.getpid())[os.getpid()] == "driver"
        monkeypatch.setattr(batch_memory, "LEAST_GB", 1e-4)
        resident, peak = batch_memory.memory_of(child.pid)
        assert 1e-3 < resident <= peak < 0.1
    finally:
        child.kill()
        child.communicate()
    assert batch_memory.memory_of(child.pid) is None
    log = tmp_path / "log.csv"
    rows = [
        f"{second},{second},{pid},{role},0.{second + 1},0.6"
        for second in range(5)
        for pid, role in ((1, "driver"), (2, "worker"))
    ]
    log.write_text("\n".join([",".join(batch_memory.COLUMNS), *rows]))
    assert "| worker | 0 to 4 | 0.20 GB | 0.30 GB | 0.50 GB | 0.60 GB |" in batch_memory.summary(log)
    pytest.importorskip("matplotlib")
    for _ in range(2):
        batch_memory.draw(log, tmp_path / "figure.svg")
        assert "asked of a worker" in (tmp_path / "figure.svg").read_text()


def test_a_row_of_the_mappings_says_whether_the_bits_are_the_same(tmp_path):
    ones = (np.ones(3), np.zeros(2))
    assert batch_mapping.difference(ones, ones) is None
    assert batch_mapping.difference(ones, (np.ones(3) + 1e-3, np.zeros(2))) == pytest.approx(1e-3)
    times = {"wall_s": 0.5, "cpu_s": 0.5, "compilation_s": 1.0, "difference": None, "walls_s": [0.5] * 5}
    mappings = {batch_mapping.REFERENCE: times, "one vmap": {**times, "wall_s": 1.0, "difference": 2e-11}}
    line = {"case": ["fits", 500, 16, 8, 2], "load": [0.1, 0.2], "mappings": mappings}
    rows = batch_mapping.table([json.loads(json.dumps(line))]).splitlines()
    assert rows[-1] == "| fits | 500 | 16 x 8 | 2 | one vmap | 1 s | 500 ms | 1 s | 2.00 | 2e-11 | 5 | 0.2 |"


@pytest.mark.slow
def test_all_mappings_compute_the_same(tmp_path):
    """Also the library itself; of fits, which take long to compile, one restart after the other is enough."""
    path, problems = tmp_path / "pairs.npz", mapped_work.problems_of_scenes(50, 2, 3)
    mapped_work.save(path, problems, None)
    mapped_work.save(path, problems, mapped_work.queue_of_restarts("fits", path, 8))
    mapped_work.loaded.cache_clear()
    for operation, calls in {
        "posteriors": (mapped_work.queue_of_pairs, mapped_work.one_vmap, mapped_work.pair_after_pair_in_chunks),
        "transport": (mapped_work.queue_of_pairs, mapped_work.one_vmap),
    }.items():
        answer = mapped_work.pair_after_pair(operation, path, 8)
        for call in calls:
            difference = batch_mapping.difference(answer, call(operation, path, 8))
            assert difference is None or difference < 1e-10
        one, _ = mapped_work.one_pair(operation, path, 8, 1)
        for leaf, whole in zip(jax.tree.leaves(one), jax.tree.leaves(answer), strict=True):
            np.testing.assert_array_equal(leaf, whole[1])


def test_problems_come_back_as_they_were_saved(tmp_path):
    problems = mapped_work.problems_of_scenes(50, 2, 3)
    mapped_work.save(tmp_path / "problems.npz", problems, None)
    back, fitted = mapped_work.loaded(tmp_path / "problems.npz")
    assert fitted is None
    np.testing.assert_array_equal(back.points.points.points, problems.points.points.points)
    np.testing.assert_array_equal(back.prior.noise_share, problems.prior.noise_share)
    np.testing.assert_array_equal(back.keys, problems.keys)
    assert back.keys.shape[:2] == (2, 3)
