"""What can happen to a run. After each fault, starting again completes it, and all is as if nothing had happened."""

import shutil
import signal

import pytest

from gmmjax.batch import BatchPair, detect_many, read_manifest
from gmmjax.batch.driver import DIED_TWICE
from gmmjax.changes import DetectionConfig
from gmmjax.errors import ComputationError, InputError
from gmmjax.reporting.batch_files import save_report
from tests.batch.runs import (
    FLAGS,
    SETTINGS,
    contents,
    done_pairs,
    is_alive,
    run,
    start,
    wait_for,
    worker,
    workers_of,
    write_manifest,
)
from tests.batch.savers import save_on_full_disk, save_slowly, save_unless_bad

COUNT = 4
CONFIG = DetectionConfig(**SETTINGS)


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    return write_manifest(tmp_path_factory.mktemp("scans"), COUNT)


@pytest.fixture(scope="module")
def pairs(scans):
    return read_manifest(scans, CONFIG)


@pytest.fixture(scope="module")
def finished(pairs, tmp_path_factory):
    """A run that nothing happened to, with reports."""
    folder = tmp_path_factory.mktemp("undisturbed") / "run"
    assert all(result.done for result in detect(pairs, folder))
    return folder


@pytest.fixture(scope="module")
def undisturbed(finished):
    return contents(finished)


def detect(pairs, folder, save=save_report):
    return list(detect_many(pairs, out=folder, config=CONFIG, executor=worker(), save=save))


def completes(pairs, folder, undisturbed, save=save_report):
    """Starts the run again; the names of the pairs that it computes."""
    results = detect(pairs, folder, save)
    assert all(result.done for result in results)
    found = contents(folder)
    assert found == {name: undisturbed[name] for name in found}
    assert len(done_pairs(folder)) == COUNT
    return {result.name for result in results if not result.reused}


@pytest.mark.slow
def test_runs_that_are_interrupted_and_killed_are_completed(scans, pairs, undisturbed, tmp_path):
    """By Ctrl-C after the first pair, and by SIGKILL after the second one, which computes nothing again."""
    folder, before = tmp_path / "run", {}
    for fault, done in ((signal.SIGINT, 1), (signal.SIGKILL, 2)):
        process = start(scans, "--out", folder, "--workers", "1", *FLAGS)
        try:
            wait_for(lambda done=done, process=process: len(done_pairs(folder)) >= done or process.poll() is not None)
            workers = workers_of(process.pid)
            process.send_signal(fault)
            _, errors = process.communicate(timeout=120)
        finally:
            process.kill()
        wait_for(lambda workers=workers: not any(map(is_alive, workers)), 30)
        if fault == signal.SIGINT:
            assert process.returncode == 130 and errors.splitlines()[-1] == "gmmjax: interrupted"
            # What is done can be looked at.
            assert (folder / "index.html").is_file() and (folder / "pairs.csv").is_file()
            before = {name: (folder / "pairs" / name / "pair.json").read_bytes() for name in done_pairs(folder)}
        else:
            assert process.returncode == -signal.SIGKILL
        assert len(done_pairs(folder)) < COUNT
    completes(pairs, folder, undisturbed)
    assert {name: (folder / "pairs" / name / "pair.json").read_bytes() for name in before} == before


def test_a_full_disk(pairs, undisturbed, tmp_path):
    with pytest.raises(ComputationError, match="start the same command again"):
        detect(pairs, tmp_path / "run", save_on_full_disk)
    assert not done_pairs(tmp_path / "run") and not list((tmp_path / "run" / "errors").iterdir())
    assert len(completes(pairs, tmp_path / "run", undisturbed)) == COUNT


def test_a_truncated_result(pairs, finished, undisturbed, tmp_path):
    folder = shutil.copytree(finished, tmp_path / "run")
    places = [folder / "pairs" / f"pair {number}" for number in range(COUNT)]
    for file in (places[0] / "labels.npz", places[1] / "pair.json", places[2] / "fits.npz"):
        file.write_bytes(file.read_bytes()[:100])
    (places[1] / "report.html").unlink()
    assert completes(pairs, folder, undisturbed) == {"pair 0", "pair 1", "pair 2"}


def test_a_file_that_vanishes(scans, undisturbed, tmp_path):
    """After the manifest was checked, before the pair is computed."""
    copy = shutil.copytree(scans.parent, tmp_path / "scans")
    pairs = read_manifest(copy / scans.name, CONFIG)
    (copy / "after2.ply").unlink()
    results = {result.name: result for result in detect(pairs, tmp_path / "run", save_slowly)}
    failed = results.pop("pair 2")
    assert not failed.done
    assert "after2.ply" in failed.pair.error and "check the path" in failed.pair.error
    assert all(result.done for result in results.values())
    shutil.copy(scans.parent / "after2.ply", copy / "after2.ply")
    results = detect(pairs, tmp_path / "run", save_slowly)
    assert [result.name for result in results if not result.reused] == ["pair 2"]
    labels = {name: own for name, own in contents(tmp_path / "run").items() if name.endswith("labels.npz")}
    assert len(labels) == COUNT and labels == {name: undisturbed[name] for name in labels}


@pytest.mark.slow
def test_a_pair_that_ends_its_worker(pairs, undisturbed, tmp_path):
    """It fails alone. The others are the same by any number of workers and in any order."""
    bad = BatchPair("bad", pairs[0].before, pairs[0].after)
    settings = {"out": tmp_path / "run", "config": CONFIG, "workers": 2, "save": save_unless_bad}
    results = {result.name: result for result in detect_many([bad, *reversed(pairs)], **settings)}
    assert results["bad"].pair.error == DIED_TWICE
    assert completes(pairs, tmp_path / "run", undisturbed, save_unless_bad) == set()


def test_two_runs_in_one_folder(scans, pairs, undisturbed, tmp_path):
    folder = tmp_path / "run"
    first = detect_many(pairs[:2], out=folder, config=CONFIG, save=save_slowly, executor=worker())
    next(first)
    second = run(scans, "--out", folder, *FLAGS)
    assert second.returncode == 2
    assert "another run is computing this folder" in second.stderr
    with pytest.raises(InputError, match="another run"):
        detect(pairs, folder)
    assert sum(result.done for result in first) == 1
    # What it wrote is no report: all are computed again.
    assert len(completes(pairs, folder, undisturbed)) == COUNT
