"""A cluster of three workers on this machine: the same results, workers that are killed, a scheduler that goes."""

import contextlib
import json
import subprocess
import sys

import numpy as np
import pytest

from gmmjax import detect_changes, read_cloud
from gmmjax.batch import BatchPair, detect_many, read_manifest
from gmmjax.changes import DetectionConfig
from gmmjax.errors import ComputationError, InputError
from tests.batch.runs import SETTINGS, contents, environment, wait_for, worker, write_manifest
from tests.batch.savers import save_slowly

COUNT = 4
CONFIG = DetectionConfig(**SETTINGS)


class Cluster:
    """A scheduler and three workers, each a process of its own."""

    def __init__(self, folder):
        self.file = folder / "scheduler.json"
        quiet = {"env": environment(), "cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(self.file)]
        self.scheduler = subprocess.Popen([*dask, *options], **quiet)
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(self.file)]
        options = ["--nthreads", "1", "--no-dashboard", "--memory-limit", "0", "--host", "127.0.0.1"]
        self.workers = [subprocess.Popen([*worker, *options], **quiet) for _ in range(3)]
        wait_for(lambda: self.file.exists() and self.file.stat().st_size, 60)

    @property
    def address(self):
        return json.loads(self.file.read_text())["address"]

    def wait(self):
        """Until all workers are there."""
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(3, timeout=120)

    def stop(self):
        for process in [*self.workers, self.scheduler]:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    return write_manifest(tmp_path_factory.mktemp("scans"), COUNT)


@pytest.fixture(scope="module")
def pairs(scans):
    return read_manifest(scans, CONFIG)


@pytest.fixture(scope="module")
def local(pairs, tmp_path_factory):
    """What processes of this machine find."""
    folder = tmp_path_factory.mktemp("local") / "run"
    assert all(result.done for result in detect_many(pairs, out=folder, config=CONFIG, executor=worker()))
    return contents(folder)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with started(tmp_path_factory.mktemp("cluster")) as made:
        yield made


@contextlib.contextmanager
def started(folder):
    pytest.importorskip("distributed")
    made = Cluster(folder)
    try:
        made.wait()
        yield made
    finally:
        made.stop()


@pytest.mark.slow
def test_clouds_are_sent_and_results_come_back_without_files(pairs, cluster):
    clouds = pairs[0].clouds.map(read_cloud)
    (result,) = detect_many([BatchPair("x", *clouds)], config=CONFIG, scheduler=cluster.address)
    expected = detect_changes(*clouds, config=CONFIG)
    np.testing.assert_array_equal(result.changes().labels_after, expected.labels_after)
    assert [change.to_dict() for change in result.changes()] == [change.to_dict() for change in expected]


def test_all_pairs_finish_when_a_worker_is_killed(pairs, local, cluster, tmp_path):
    results = detect_many(pairs, out=tmp_path / "run", config=CONFIG, scheduler=cluster.address, save=save_slowly)
    next(results)
    cluster.workers[0].kill()
    assert [result.done for result in results] == [True] * (COUNT - 1)
    assert contents(tmp_path / "run") == local


@pytest.mark.slow
def test_a_scheduler_that_goes_is_said_and_the_run_goes_on_later(pairs, local, tmp_path):
    folder = tmp_path / "run"
    with started(tmp_path) as cluster:
        results = detect_many(pairs, out=folder, config=CONFIG, scheduler=cluster.address, save=save_slowly)
        next(results)
        cluster.scheduler.kill()
        with pytest.raises(ComputationError, match=r"the scheduler at tcp://.* has gone .* the same command again"):
            list(results)
    # What was made in the same way is done, the rest is computed here.
    results = list(detect_many(pairs, out=folder, config=CONFIG, executor=worker(), save=save_slowly))
    assert any(result.reused for result in results)
    assert contents(folder) == local


@pytest.mark.slow
def test_nobody_at_the_address(pairs):
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match=r"scheduler tcp://127.0.0.1:9: cannot be reached .* check address"):
        list(detect_many(pairs, scheduler="tcp://127.0.0.1:9"))
