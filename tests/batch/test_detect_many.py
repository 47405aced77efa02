"""What is computed, what is kept, and that it is what `detect_changes` finds."""

import dataclasses
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from gmmjax import detect_changes
from gmmjax.batch import BatchPair, Shard, detect_many, read_manifest, run_folder
from gmmjax.changes import DetectionConfig, RestartFits
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.errors import ComputationError, InputError
from tests.batch.runs import SETTINGS, cloud, contents, environment, worker, write_manifest

CONFIG = DetectionConfig(**SETTINGS)


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    return write_manifest(tmp_path_factory.mktemp("scans"), 3)


@pytest.fixture(scope="module")
def finished(scans, tmp_path_factory):
    """A run of three pairs that is done; tests copy it."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    assert [result.done for result in detect(scans, folder)] == [True] * 3
    return folder


@pytest.fixture
def copy(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "run")


def detect(scans, folder, config=CONFIG, **options):
    return list(detect_many(read_manifest(scans, config), out=folder, config=config, executor=worker(), **options))


def computed(results):
    return sorted(result.name for result in results if not result.reused)


def record(folder, name="pair 0"):
    return json.loads((folder / "pairs" / name / "pair.json").read_text())


def test_results_are_those_of_single_detections():
    pairs = [BatchPair("x", cloud(0, 4), cloud(1)), BatchPair("y", cloud(2), cloud(3, 4))]
    results = {result.name: result for result in detect_many(iter(pairs), config=CONFIG, executor=worker())}
    for pair in pairs:
        expected = detect_changes(pair.before, pair.after, config=CONFIG).to_dict()
        found = results[pair.name].changes().to_dict()
        del expected["diagnostics"]["seconds"]
        assert found == expected
        assert results[pair.name].pair.changes == 1


def test_rows_say_what_the_record_says(finished):
    folder = run_folder(finished)
    for name in ("pair 0", "pair 1", "pair 2"):
        kept = folder.result(name)
        changes = json.loads((folder.pair(name) / "changes.json").read_text())
        assert kept.pair.changes == len(changes["changes"]) == len(kept.changes)
        assert kept.pair.restarts == 2
        assert [row.probability for row in kept.changes] == [own["probability"] for own in changes["changes"]]
        assert "seconds" not in changes["diagnostics"]


def test_what_is_done_is_not_computed_again(scans, copy):
    before = {name: record(copy, name)["finished"] for name in ("pair 0", "pair 1", "pair 2")}
    assert computed(detect(scans, copy)) == []
    assert {name: record(copy, name)["finished"] for name in before} == before


def test_a_copied_folder_is_known_by_its_content(scans, finished, tmp_path):
    shutil.copytree(finished, tmp_path / "run", copy_function=shutil.copyfile)
    assert computed(detect(scans, tmp_path / "run")) == []


def test_another_input_is_computed_again_and_nothing_else(scans, copy, tmp_path):
    shutil.copytree(scans.parent, tmp_path / "scans")
    shutil.copy(tmp_path / "scans" / "after0.ply", tmp_path / "scans" / "after1.ply")
    assert computed(detect(tmp_path / "scans" / scans.name, copy)) == ["pair 1"]


def test_other_settings_need_overwrite(scans, copy):
    other = dataclasses.replace(CONFIG, seed=7)
    with pytest.raises(InputError, match=r"holds a run with other settings \(seed 'default'\); .* --overwrite"):
        detect(scans, copy, other)
    assert computed(detect(scans, copy, other, overwrite=True)) == ["pair 0", "pair 1", "pair 2"]
    assert record(copy)["request"]["settings"]["seed"] == 7


def test_settings_of_one_pair(scans, copy):
    pairs = read_manifest(scans, CONFIG)
    pairs[1] = dataclasses.replace(pairs[1], config=dataclasses.replace(CONFIG, seed=7))
    assert computed(detect_many(pairs, out=copy, config=CONFIG, executor=worker())) == ["pair 1"]


def test_another_version_is_computed_again(scans, copy):
    path = copy / "pairs" / "pair 2" / "pair.json"
    path.write_text(json.dumps({**record(copy, "pair 2"), "version": "0.0.9"}))
    assert computed(detect(scans, copy)) == ["pair 2"]


def test_more_pairs_may_come_later(scans, copy, tmp_path):
    shutil.copytree(scans.parent, tmp_path / "scans")
    manifest = write_manifest(tmp_path / "scans", 4, "more.csv")
    assert computed(detect(manifest, copy)) == ["pair 3"]


def test_more_restarts_are_added_to_those_that_are_there(scans, finished, copy, tmp_path, monkeypatch):
    more = dataclasses.replace(CONFIG, restarts=5)
    before = RestartFits.load(copy / "pairs" / "pair 0" / "fits.npz")
    marked = {name: values.copy() for name, values in before.arrays.items()}
    marked["steps"] += 100_000
    results = detect(scans, copy, more)
    assert computed(results) == ["pair 0", "pair 1", "pair 2"]
    assert all(result.pair.restarts == 5 for result in results)
    detect(scans, tmp_path / "at once", more)
    assert contents(copy) == contents(tmp_path / "at once")
    # That the first ones were not computed again shows where they are marked.
    pair = copy / "pairs" / "pair 0"
    RestartFits(before.method, marked).save(pair / "fits.npz")
    rewritten = record(copy)
    from gmmjax.batch.fingerprint import Fingerprint

    rewritten["files"]["fits.npz"] = dataclasses.asdict(Fingerprint.of(pair / "fits.npz"))
    (pair / "pair.json").write_text(json.dumps(rewritten))
    detect(scans, copy, dataclasses.replace(CONFIG, restarts=6))
    steps = RestartFits.load(pair / "fits.npz").arrays["steps"]
    assert (steps[:2] > 100_000).all() and (steps[2:] < 100_000).all() and len(steps) == 6


def test_fewer_restarts_need_no_fit(scans, copy):
    fewer = dataclasses.replace(CONFIG, restarts=1)
    results = detect(scans, copy, fewer)
    assert all(result.pair.restarts == 1 for result in results)
    # What was computed is kept for later.
    assert len(RestartFits.load(copy / "pairs" / "pair 0" / "fits.npz")) == 2


def test_until_stable_ends_where_the_probabilities_have_settled(scans, tmp_path):
    most = dataclasses.replace(CONFIG, restarts=32)
    results = detect(scans, tmp_path / "run", most, until_stable=0.05)
    for result in results:
        assert result.pair.settled is (result.pair.difference < 0.05)
        assert 2 < result.pair.restarts <= 32
    assert any(result.pair.restarts < 32 for result in results)


def test_until_stable_needs_a_most(scans, tmp_path):
    with pytest.raises(InputError, match="until_stable needs restarts, the most that are made"):
        detect(scans, tmp_path / "run", dataclasses.replace(CONFIG, restarts=None), until_stable=0.1)
    with pytest.raises(InputError, match=r"until_stable=2\.0 must lie between 0 and 1"):
        detect(scans, tmp_path / "run", until_stable=2.0)


def test_shards_are_the_run(scans, finished, tmp_path):
    folder = tmp_path / "run"
    names = [[result.name for result in detect(scans, folder, shard=Shard(number, 2))] for number in (1, 2)]
    assert [sorted(own) for own in names] == [["pair 0", "pair 2"], ["pair 1"]]
    assert contents(folder) == contents(finished)
    assert computed(detect(scans, folder)) == []


def test_what_is_wrong_with_a_shard():
    for text in ("3", "0/2", "3/2", "a/b", "1/", "-1/2"):
        with pytest.raises(InputError, match="shard"):
            Shard.parse(text)


def test_a_bad_pair_stops_no_other(scans, tmp_path):
    pairs = [*read_manifest(scans, CONFIG)[:1], BatchPair("flat", np.zeros((20, 3)), cloud(1))]
    results = {
        result.name: result for result in detect_many(pairs, out=tmp_path / "run", config=CONFIG, executor=worker())
    }
    assert results["pair 0"].done and not results["flat"].done
    assert "before" in results["flat"].pair.error
    with pytest.raises(ComputationError, match="pair flat: failed"):
        results["flat"].changes()
    assert run_folder(tmp_path / "run").failed("flat").error == results["flat"].pair.error
    with pytest.raises(ComputationError, match="pair flat: before"):
        list(detect_many(pairs, config=CONFIG, executor=worker(), fail_fast=True))


def test_clouds_in_memory_with_views_are_kept_and_known_again(tmp_path):
    views = SensorViews(np.eye(4)[None], (170.0, 170.0), 50.0)
    before = PointCloud.from_rows(cloud(0, 4), source="left")
    pair = BatchPair("x", before, cloud(1), views_before=views)
    for expected in (["x"], []):
        assert computed(detect_many([pair], out=tmp_path / "run", config=CONFIG, executor=worker())) == expected
    other = dataclasses.replace(pair, views_before=SensorViews(np.eye(4)[None], (170.0, 170.0), 40.0))
    assert computed(detect_many([other], out=tmp_path / "run", config=CONFIG, executor=worker())) == ["x"]


def test_names_that_are_there_twice():
    pairs = [BatchPair("x", cloud(0), cloud(1)), BatchPair("X", cloud(0), cloud(1))]
    with pytest.raises(InputError, match=r"pairs: names that are there more than once: 'x'; give"):
        detect_many(pairs)
    with pytest.raises(InputError, match=r"the name 'x' is there more than once"):
        list(detect_many(iter([pairs[0], pairs[0]]), config=CONFIG, executor=worker()))


def test_a_folder_of_something_else(tmp_path, scans):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match=r"holds something else \(thesis.txt\)"):
        detect(scans, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_damaged_record_of_the_run(scans, copy):
    (copy / "run.json").write_text("{")
    with pytest.raises(InputError, match=r"run\.json: is not JSON"):
        detect(scans, copy)
    climbing = {"schema_version": 1, "pairs": ["../x"], "settings": {}, "series": None, "epochs": [], "version": "1"}
    (copy / "run.json").write_text(json.dumps(climbing))
    with pytest.raises(InputError, match=r"run\.json: is not the record of a run \(name='../x' must not have slashes"):
        detect(scans, copy)
    assert computed(detect(scans, copy, overwrite=True)) == []


@pytest.mark.slow
def test_a_script_without_a_guard_is_told(tmp_path, scans):
    script = tmp_path / "script.py"
    script.write_text(
        "from gmmjax.batch import detect_many, read_manifest\n"
        "from pathlib import Path\n"
        f"list(detect_many(read_manifest(Path({str(scans)!r}))[:1]))\n"
    )
    done = subprocess.run([sys.executable, script], env=environment(), capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    # One line of ours, the script's own exception; a thread of the standard library may write after it.
    (told,) = [line for line in done.stderr.splitlines() if line.startswith("gmmjax.")]
    assert 'a script that starts them needs if __name__ == "__main__":' in told


def test_warnings_are_in_the_row(tmp_path):
    stray = np.concatenate([cloud(1), [[2000.0, 0.0, 0.0]]])
    (result,) = detect_many([BatchPair("x", cloud(0), stray)], config=CONFIG, executor=worker())
    assert "after: 1 stray point lies very far from all others" in result.pair.warnings
