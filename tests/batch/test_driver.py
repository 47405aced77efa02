"""Deaths of workers and their pairs, with a pool that computes at once and dies when it is told."""

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

NAMES = [f"pair {number}" for number in range(8)]


class FakePool(AbstractPool):
    """Computes when a call is handed over."""

    def __init__(self, capacity=2):
        self.capacity, self.calls, self.stopped = capacity, [], None

    def submit(self, function, *arguments):
        self.calls.append(arguments[0].pair.name)
        future = Future()
        try:
            future.set_result(function(*arguments))
        except BaseException as error:
            future.set_exception(error)
        return future

    def stop(self, *, at_once):
        self.stopped = at_once


def tasks(names=NAMES):
    return [PairTask(BatchPair(name, "before.ply", "after.ply"), DetectionConfig()) for name in names]


def compute(task):
    row = PairRow(task.pair.name, "done", seconds=1.0)
    return PairResult(task.pair.name, PairRecord(Request({}, None, None, "save"), {}, {}, row, (), {}, 0.0))


def raising(error):
    def work(task):
        raise error

    return work


class DyingWork:
    """The worker dies with a pair, the first so many times."""

    def __init__(self, name, times):
        self.name, self.left = name, times

    def __call__(self, task):
        if self.left and task.pair.name == self.name:
            self.left -= 1
            raise BrokenExecutor
        return compute(task)


@pytest.mark.parametrize("work", [compute, DyingWork("pair 3", 1)])
def test_every_pair_has_one_result_also_where_a_worker_dies_once(work):
    pool = FakePool()
    results = list(results_of(tasks(), pool, work))
    assert sorted(result.name for result in results) == NAMES
    assert all(result.record is not None for result in results)
    assert pool.stopped is False


def test_tasks_are_taken_only_as_workers_get_free():
    waiting, pool = iter(tasks()), FakePool(capacity=3)
    results = results_of(waiting, pool, compute)
    next(results)
    assert len(list(waiting)) == 5
    results.close()
    assert pool.stopped is True


def test_a_pair_that_always_ends_its_worker_fails_and_no_other():
    pool = FakePool(capacity=3)
    results = list(results_of(tasks(), pool, DyingWork("pair 3", 99)))
    failed = [result for result in results if result.record is None]
    assert [(result.name, result.error) for result in failed] == [("pair 3", DIED_TWICE)]
    assert sorted(result.name for result in results) == NAMES
    # The second time it is alone, after all the others.
    assert pool.calls[-1] == "pair 3"


def test_when_every_worker_dies_each_pair_is_tried_twice():
    pool = FakePool()
    results = list(results_of(tasks(), pool, raising(BrokenExecutor())))
    assert sorted(result.name for result in results) == NAMES
    assert all(result.error == DIED_TWICE for result in results)
    assert sorted(pool.calls) == sorted(2 * NAMES)


def test_what_cannot_be_written_ends_the_run():
    pool = FakePool()
    with pytest.raises(ComputationError, match=r"No space left .* start the same command again"):
        list(results_of(tasks(), pool, lambda task: PairResult("x", None, not_written="run: No space left on device")))
    assert pool.stopped is True


class Lost(FakePool):
    def lost(self, error):
        return ComputationError("the scheduler has gone") if isinstance(error, CancelledError) else None


@pytest.mark.parametrize(
    ("pool", "error", "says"),
    [
        (Lost(), CancelledError(), "the scheduler has gone"),
        (FakePool(), ModuleNotFoundError("No module named 'gmmjax'"), "No module named 'gmmjax'"),
    ],
)
def test_a_pool_that_cannot_compute_is_said(pool, error, says):
    with pytest.raises(ComputationError, match=says):
        list(results_of(tasks(), pool, raising(error)))
