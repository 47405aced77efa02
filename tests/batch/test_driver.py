"""Chunks, deaths of workers and their pairs, with a pool that computes at once and dies when it is told."""

from concurrent.futures import BrokenExecutor, CancelledError, Future

import pytest

from gmmjax.batch.driver import DIED_TWICE, results_of
from gmmjax.batch.pair_record import PairRecord, Request
from gmmjax.batch.pools import AbstractPool
from gmmjax.batch.rows import PairRow
from gmmjax.batch.scan_pair import BatchPair
from gmmjax.batch.worker import PairResult, PairTask
from gmmjax.changes import DetectionConfig
from gmmjax.errors import ComputationError


class FakePool(AbstractPool):
    """Computes when a call is handed over."""

    def __init__(self, capacity=2):
        self.capacity, self.chunks, self.stopped = capacity, [], None

    def submit(self, function, *arguments):
        self.chunks.append([task.pair.name for task in arguments[0]])
        future = Future()
        try:
            future.set_result(function(*arguments))
        except BaseException as error:
            future.set_exception(error)
        return future

    def stop(self, *, at_once):
        self.stopped = at_once


def task(name):
    return PairTask(BatchPair(name, "before.ply", "after.ply"), DetectionConfig())


def tasks(count):
    return [task(f"pair {number}") for number in range(count)]


def result(task, seconds=1.0):
    record = PairRecord(
        Request({}, None, None, "save"), {}, {}, PairRow(task.pair.name, "done", seconds=seconds), (), (), {}, 0.0
    )
    return PairResult(task.pair.name, record)


def compute(chunk):
    return [result(task) for task in chunk]


class DyingWork:
    """The worker dies with a pair, the first so many times."""

    def __init__(self, name, times):
        self.name, self.left = name, times

    def __call__(self, chunk):
        if self.left and any(task.pair.name == self.name for task in chunk):
            self.left -= 1
            raise BrokenExecutor
        return compute(chunk)


def names(results):
    return sorted(result.name for result in results)


def test_every_pair_has_one_result():
    results = list(results_of(tasks(20), FakePool(), compute))
    assert names(results) == names(tasks_as_results(20))
    assert all(result.record is not None for result in results)


def tasks_as_results(count):
    return [result(task) for task in tasks(count)]


def test_tasks_are_taken_only_as_workers_get_free():
    taken = []

    def source():
        for own in tasks(100):
            taken.append(own)
            yield own

    pool = FakePool(capacity=3)
    results = results_of(source(), pool, compute)
    next(results)
    assert len(taken) < 10
    results.close()
    assert pool.stopped is True


def test_quick_pairs_come_in_larger_chunks():
    pool = FakePool(capacity=1)
    quick = lambda chunk: [result(task, seconds=0.01) for task in chunk]  # noqa: E731
    list(results_of(tasks(300), pool, quick, chunk_seconds=1.0, largest_chunk=32))
    sizes = [len(chunk) for chunk in pool.chunks]
    assert sizes[0] == 1
    assert max(sizes) == 32


def test_a_worker_that_dies_once_loses_nothing():
    results = list(results_of(tasks(8), FakePool(), DyingWork("pair 3", 1)))
    assert names(results) == names(tasks_as_results(8))
    assert all(result.record is not None for result in results)


def test_a_pair_that_always_ends_its_worker_fails_and_no_other():
    pool = FakePool(capacity=3)
    results = list(results_of(tasks(8), pool, DyingWork("pair 3", 99)))
    failed = [result for result in results if result.record is None]
    assert [(result.name, result.error) for result in failed] == [("pair 3", DIED_TWICE)]
    assert names(results) == names(tasks_as_results(8))
    # The second time it is alone, after all the others.
    assert pool.chunks[-1] == ["pair 3"]


def test_when_every_worker_dies_each_pair_is_tried_twice():
    def die(chunk):
        raise BrokenExecutor

    pool = FakePool()
    results = list(results_of(tasks(4), pool, die))
    assert names(results) == names(tasks_as_results(4))
    assert all(result.error == DIED_TWICE for result in results)
    assert sum(map(len, pool.chunks)) == 8


def test_what_cannot_be_written_ends_the_run():
    def full(chunk):
        return [PairResult(task.pair.name, None, not_written="run: No space left on device") for task in chunk]

    pool = FakePool()
    with pytest.raises(ComputationError, match=r"No space left .* start the same command again"):
        list(results_of(tasks(4), pool, full))
    assert pool.stopped is True


def test_a_lost_pool_is_said():
    class Lost(FakePool):
        def lost(self, error):
            return ComputationError("the scheduler has gone") if isinstance(error, CancelledError) else None

    def cancelled(chunk):
        raise CancelledError

    with pytest.raises(ComputationError, match="the scheduler has gone"):
        list(results_of(tasks(4), Lost(), cancelled))


def test_a_worker_without_the_package_is_said():
    def without(chunk):
        raise ModuleNotFoundError("No module named 'gmmjax'")

    with pytest.raises(ComputationError, match="No module named 'gmmjax'"):
        list(results_of(tasks(2), FakePool(), without))
