"""Hands pairs to a pool of workers, and goes on when a worker dies."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeAlias

from gmmjax.batch.pools import AbstractPool, died
from gmmjax.batch.worker import PairResult, PairTask, detect_pair, recorded
from gmmjax.errors import ComputationError, one_line

Work: TypeAlias = Callable[[PairTask], PairResult]
DIED_TWICE = (
    "its worker process died twice, the second time with nothing else running: most likely there is too little memory "
    "for it, or the system ended the process; try it with a smaller max_points or a crop"
)


def results_of(tasks: Iterable[PairTask], pool: AbstractPool, work: Work = detect_pair) -> Iterator[PairResult]:
    """The results of pairs, as they are done.

    A pair whose worker dies is tried once more when nothing else runs, and fails if its worker dies again.

    Args:
        tasks: the pairs; taken from as workers get free.
        pool: where they are computed. It is stopped in the end; at once where the caller does not want the rest.
        work: what a worker does with a pair.

    Raises:
        ComputationError: the pool is lost, or the results cannot be written.
    """
    driver = _Driver(iter(tasks), pool, work)
    at_once = True
    try:
        yield from driver.results()
        at_once = False
    finally:
        pool.stop(at_once=at_once)


class _Driver:
    """The state of a run: what is computed, and what is suspected of having ended its worker."""

    def __init__(self, tasks: Iterator[PairTask], pool: AbstractPool, work: Work):
        self._tasks, self._pool, self._work = tasks, pool, work
        self._suspects: deque[PairTask] = deque()
        self._alone: PairTask | None = None
        self._running: dict[Future[Any], PairTask] = {}
        self._done: SimpleQueue[Future[Any]] = SimpleQueue()

    def results(self) -> Iterator[PairResult]:
        while self._fill():
            future = self._done.get()
            result = self._result(future, self._running.pop(future))
            if result is not None:
                yield result

    def _fill(self) -> bool:
        """Hands out pairs while there is room; whether anything is being computed."""
        while self._alone is None and len(self._running) < self._pool.capacity:
            task = next(self._tasks, None)
            if task is None:
                break
            self._submit(task)
        if not self._running and self._suspects:
            self._alone = self._suspects.popleft()
            self._submit(self._alone)
        return bool(self._running)

    def _submit(self, task: PairTask) -> None:
        future = self._pool.submit(self._work, task)
        self._running[future] = task
        # Each tells that it is done: to look through all of them would take longer the more workers there are.
        future.add_done_callback(self._done.put)

    def _result(self, future: "Future[Any]", task: PairTask) -> PairResult | None:
        """The result of a pair; None where its worker died and it is tried again."""
        alone, self._alone = self._alone is not None, None
        try:
            result: PairResult = future.result()
        # A future that was cancelled, by a scheduler that has gone, is no `Exception`.
        except BaseException as error:
            self._check_death(error)
            return self._after_death(task, alone=alone)
        if result.not_written:
            raise ComputationError(f"{result.not_written}; what is done is kept: start the same command again then")
        return result

    def _check_death(self, error: BaseException) -> None:
        """Ends the run where an error of a future does not mean that a single worker died."""
        if isinstance(error, KeyboardInterrupt | SystemExit):
            raise error
        if (lost := self._pool.lost(error)) is not None:
            raise lost from error
        if not died(error):
            reason = f"{type(error).__name__}: {one_line(error)}"
            raise ComputationError(f"a worker could not work ({reason})") from error

    def _after_death(self, task: PairTask, *, alone: bool) -> PairResult | None:
        # It may have died after it had written the result.
        if (record := recorded(task)) is not None:
            return PairResult(task.pair.name, record)
        if alone:
            return PairResult(task.pair.name, None, DIED_TWICE)
        self._suspects.append(task)
        return None
