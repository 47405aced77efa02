"""What can happen to a run. After each fault, starting again completes it, and all is as if nothing had happened."""

import os
import shutil
import signal

import pytest

from gmmjax.batch import BatchPair, detect_many, read_manifest
from gmmjax.batch.driver import DIED_TWICE
from gmmjax.changes import DetectionConfig
from gmmjax.errors import InputError
from tests.batch.runs import (
    FLAGS,
    SETTINGS,
    contents,
    done_pairs,
    is_alive,
    kill,
    run,
    run_process,
    start,
    wait_for,
    workers_of,
    write_manifest,
)
from tests.batch.savers import save_slowly, save_unless_bad

COUNT = 5


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans")
    return write_manifest(folder, COUNT)


@pytest.fixture(scope="module")
def undisturbed(scans, tmp_path_factory):
    """What a run finds that nothing happens to."""
    folder = tmp_path_factory.mktemp("undisturbed") / "run"
    done = run(scans, "--out", folder, *FLAGS)
    assert done.returncode == 0, done.stderr
    return contents(folder)


def completes(scans, folder, undisturbed, *words):
    done = run(scans, "--out", folder, "--workers", "1", *FLAGS, *words)
    assert done.returncode == 0, done.stderr
    assert contents(folder) == undisturbed
    return done


def interrupted(scans, folder, fault):
    """A run to which the fault happens when its first pair is done; one worker, so that most is still to do."""
    process = start(scans, "--out", folder, "--workers", "1", *FLAGS)
    try:
        wait_for(lambda: done_pairs(folder) or process.poll() is not None)
        workers = workers_of(process.pid)
        fault(process, workers)
        output, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    return process.returncode, output, errors, workers


@pytest.mark.slow
def test_number_of_workers_and_order_change_nothing(scans, undisturbed, tmp_path):
    pairs = read_manifest(scans, DetectionConfig(**SETTINGS))
    results = detect_many(reversed(pairs), out=tmp_path / "run", config=DetectionConfig(**SETTINGS), workers=1)
    assert all(result.done for result in results)
    found = contents(tmp_path / "run")
    assert found == {name: undisturbed[name] for name in found}
    assert {name.split("/")[-1] for name in found} == {"changes.json", "labels.npz", "fits.npz"}


@pytest.mark.slow
def test_a_killed_worker(scans, undisturbed, tmp_path):
    status, output, errors, _ = interrupted(scans, tmp_path / "run", lambda process, workers: kill(workers[0]))
    # The run itself goes on.
    assert status == 0, errors
    assert output.startswith(f"{COUNT} pairs done")
    assert contents(tmp_path / "run") == undisturbed


@pytest.mark.slow
def test_a_killed_driver(scans, undisturbed, tmp_path):
    folder = tmp_path / "run"
    status, *_, workers = interrupted(scans, folder, lambda process, workers: process.kill())
    assert status == -signal.SIGKILL
    wait_for(lambda: not any(map(is_alive, workers)), 30)
    assert len(done_pairs(folder)) < COUNT
    completes(scans, folder, undisturbed)


@pytest.mark.slow
def test_an_interrupted_run(scans, undisturbed, tmp_path):
    folder = tmp_path / "run"

    def interrupt(process, workers):
        process.send_signal(signal.SIGINT)

    status, _, errors, workers = interrupted(scans, folder, interrupt)
    assert status == 130
    assert errors.splitlines()[-1] == "gmmjax: interrupted"
    wait_for(lambda: not any(map(is_alive, workers)), 30)
    # What is done can be looked at.
    assert (folder / "index.html").is_file() and (folder / "pairs.csv").is_file()
    before = {name: (folder / "pairs" / name / "pair.json").read_bytes() for name in done_pairs(folder)}
    assert 0 < len(before) < COUNT
    completes(scans, folder, undisturbed)
    # And it is not computed again.
    assert {name: (folder / "pairs" / name / "pair.json").read_bytes() for name in before} == before


@pytest.mark.slow
def test_a_full_disk(scans, undisturbed, tmp_path):
    folder = tmp_path / "run"

    # A limit on the size of files stands for a disk without space: writing fails in the middle.
    limited = ["sh", "-c", 'ulimit -f 16; exec "$@"', "sh"]
    done = run_process(scans, "--out", folder, "--workers", "1", *FLAGS, before=limited)
    assert done.returncode == 1
    assert "cannot be written" in done.stderr and "start the same command again" in done.stderr
    assert not done_pairs(folder) and not list((folder / "errors").iterdir())
    completes(scans, folder, undisturbed)


@pytest.mark.slow
def test_a_truncated_result(scans, undisturbed, tmp_path):
    folder = tmp_path / "run"
    completes(scans, folder, undisturbed)
    pairs = folder / "pairs"
    for file in (pairs / "pair 0" / "labels.npz", pairs / "pair 1" / "pair.json", pairs / "pair 2" / "fits.npz"):
        file.write_bytes(file.read_bytes()[:100])
    (pairs / "pair 3" / "report.html").unlink()
    kept = (pairs / "pair 4" / "pair.json").read_bytes()
    completes(scans, folder, undisturbed)
    assert (pairs / "pair 4" / "pair.json").read_bytes() == kept


@pytest.mark.slow
def test_a_file_that_vanishes(scans, undisturbed, tmp_path):
    """After the manifest was checked, before the pair is computed."""
    copy = tmp_path / "scans"
    shutil.copytree(scans.parent, copy)
    config = DetectionConfig(**SETTINGS)
    pairs = read_manifest(copy / scans.name, config)
    (copy / "after2.ply").unlink()
    results = {result.name: result for result in detect_many(pairs, out=tmp_path / "run", config=config)}
    failed = results.pop("pair 2")
    assert not failed.done
    assert "after2.ply" in failed.pair.error and "check the path" in failed.pair.error
    assert all(result.done for result in results.values())
    shutil.copy(scans.parent / "after2.ply", copy / "after2.ply")
    results = list(detect_many(pairs, out=tmp_path / "run", config=config))
    assert sum(result.reused for result in results) == COUNT - 1
    labels = [name for name in contents(tmp_path / "run") if name.endswith("labels.npz")]
    assert len(labels) == COUNT
    assert all(contents(tmp_path / "run")[name] == undisturbed[name] for name in labels)


@pytest.mark.slow
def test_a_pair_that_ends_its_worker(scans, tmp_path):
    config = DetectionConfig(**SETTINGS)
    pairs = read_manifest(scans, config)[:2]
    bad = BatchPair("bad", pairs[0].before, pairs[0].after)
    settings = {"out": tmp_path / "run", "config": config, "workers": 2, "save": save_unless_bad}
    results = {result.name: result for result in detect_many([bad, *pairs], **settings)}
    assert results["bad"].pair.error == DIED_TWICE
    assert all(results[pair.name].done for pair in pairs)
    # Started again it is tried again, and only it.
    again = list(detect_many([bad, *pairs], **settings))
    assert [result.name for result in again if not result.reused] == ["bad"]


@pytest.mark.slow
def test_two_runs_in_one_folder(scans, undisturbed, tmp_path):
    folder, config = tmp_path / "run", DetectionConfig(**SETTINGS)
    pairs = read_manifest(scans, config)[:3]
    first = detect_many(pairs, out=folder, config=config, save=save_slowly, workers=1)
    next(first)
    second = run(scans, "--out", folder, *FLAGS)
    assert second.returncode == 2
    assert "another run is computing this folder" in second.stderr
    with pytest.raises(InputError, match="another run"):
        next(detect_many(pairs, out=folder, config=config))
    assert sum(result.done for result in first) == 2
    # Its own reports are missing, so that the command makes them.
    completes(scans, folder, undisturbed)


@pytest.mark.slow
def test_no_process_is_left(scans, tmp_path):
    process = start(scans, "--out", tmp_path / "run", "--workers", "2", *FLAGS)
    workers = wait_for(lambda: workers_of(process.pid) or process.poll() is not None)
    process.communicate(timeout=120)
    assert process.returncode == 0
    assert not any(is_alive(worker) for worker in workers if worker != os.getpid())
