"""Hands pairs to a pool of workers in chunks, and goes on when a worker dies."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeAlias

from gmmjax.batch.pools import AbstractPool, died
from gmmjax.batch.run_folder import recorded
from gmmjax.batch.worker import PairResult, PairTask, detect_in_chunk
from gmmjax.errors import ComputationError, one_line

Chunk: TypeAlias = tuple[PairTask, ...]
Work: TypeAlias = Callable[[Sequence[PairTask]], list[PairResult]]


# Work that is worth a message, seconds of a worker: with much more the last chunks keep some workers busy while the
# others have nothing left.
CHUNK_SECONDS = 4.0
# Pairs in a chunk, at most: what is lost when a worker dies is done again.
LARGEST_CHUNK = 64


def results_of(
    tasks: Iterable[PairTask],
    pool: AbstractPool,
    work: Work = detect_in_chunk,
    *,
    chunk_seconds: float = CHUNK_SECONDS,
    largest_chunk: int = LARGEST_CHUNK,
) -> Iterator[PairResult]:
    """The results of pairs, as they are done.

    A pair whose worker dies is tried once more when nothing else runs, and fails if its worker dies again. All other
    pairs of its chunk are computed again, unless their results were kept.

    Args:
        tasks: the pairs; taken from as workers get free.
        pool: where they are computed. It is stopped in the end; at once where the caller does not want the rest.
        work: what a worker does with a chunk.
        chunk_seconds: work that is worth a message; 0: every pair is one of its own.
        largest_chunk: pairs in a chunk, at most.

    Raises:
        ComputationError: the pool is lost, or the results cannot be written.
    """
    driver = _Driver(iter(tasks), pool, work, chunk_seconds, largest_chunk)
    at_once = True
    try:
        yield from driver.results()
        at_once = False
    finally:
        pool.stop(at_once=at_once)


class _Driver:
    """The state of a run: what waits, what is computed, and what is suspected of having ended its worker."""

    def __init__(self, tasks: Iterator[PairTask], pool: AbstractPool, work: Work, chunk_seconds: float, largest: int):
        self._tasks, self._pool, self._work = tasks, pool, work
        self._chunk_seconds, self._largest_chunk = chunk_seconds, largest
        self._again: deque[PairTask] = deque()
        self._suspects: deque[PairTask] = deque()
        self._running: dict[Future[Any], Chunk] = {}
        self._done: SimpleQueue[Future[Any]] = SimpleQueue()
        self._alone: PairTask | None = None
        self._seconds_of_pair = chunk_seconds

    def results(self) -> Iterator[PairResult]:
        while self._fill():
            yield from self._finished(self._done.get())

    def _fill(self) -> bool:
        """Hands out chunks while there is room; whether anything is being computed."""
        while self._alone is None and len(self._running) < self._pool.capacity and (chunk := self._next_chunk()):
            self._submit(chunk)
        if not self._running and self._suspects:
            self._alone = self._suspects.popleft()
            self._submit((self._alone,))
        return bool(self._running)

    def _next_chunk(self) -> Chunk:
        size = self._chunk_seconds / max(self._seconds_of_pair, 1e-9)
        chunk: list[PairTask] = []
        while len(chunk) < min(max(1, round(size)), self._largest_chunk):
            task = self._again.popleft() if self._again else next(self._tasks, None)
            if task is None:
                break
            chunk.append(task)
        return tuple(chunk)

    def _submit(self, chunk: Chunk) -> None:
        future = self._pool.submit(self._work, chunk)
        self._running[future] = chunk
        # Each tells that it is done: to look through all of them would take longer the more workers there are.
        future.add_done_callback(self._done.put)

    def _finished(self, future: "Future[Any]") -> Iterator[PairResult]:
        chunk = self._running.pop(future)
        alone, self._alone = self._alone, None
        try:
            results: list[PairResult] = future.result()
        # A future that was cancelled, by a scheduler that has gone, is no `Exception`.
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt | SystemExit):
                raise
            if (lost := self._pool.lost(error)) is not None:
                raise lost from error
            if not died(error):
                raise ComputationError(
                    f"a worker could not work ({type(error).__name__}: {one_line(error)})"
                ) from error
            yield from self._after_death(chunk, alone)
            return
        self._learn(results)
        for result in results:
            if result.not_written:
                raise ComputationError(f"{result.not_written}; what is done is kept: start the same command again then")
            yield result

    def _after_death(self, chunk: Chunk, alone: PairTask | None) -> Iterator[PairResult]:
        """Sorts out a chunk whose worker died: pairs are computed in their order, and kept as they are done."""
        left = []
        for task in chunk:
            record = recorded(task)
            if record is None:
                left.append(task)
            else:
                yield PairResult(task.pair.name, record)
        if left and alone is not None:
            yield PairResult(alone.pair.name, None, DIED_TWICE)
        elif left:
            self._suspects.append(left[0])
            self._again.extend(left[1:])

    def _learn(self, results: Sequence[PairResult]) -> None:
        """What a pair takes, for the size of the next chunks: the latest ones count most."""
        seconds = [result.record.pair.seconds or 0.0 for result in results if result.record is not None]
        if seconds:
            self._seconds_of_pair += 0.5 * (sum(seconds) / len(seconds) - self._seconds_of_pair)


DIED_TWICE = (
    "its worker process died twice, the second time with nothing else running: most likely there is too little memory "
    "for it, or the system ended the process; try it with a smaller max_points or a crop"
)
