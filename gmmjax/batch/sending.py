"""Pairs for workers that do not see the files: read here, computed there, written here."""

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

from gmmjax.batch.driver import results_of
from gmmjax.batch.pools import AbstractPool
from gmmjax.batch.worker import FoundPair, PairResult, PairTask, ReadPair, earlier_fits, read_pair, write_pair
from gmmjax.errors import ComputationError, InputError


class _Sent(NamedTuple):
    """A task whose clouds are with a worker."""

    task: PairTask
    read: ReadPair


def sent_results(tasks: Iterator[PairTask], pool: AbstractPool) -> Iterator[PairResult]:
    """The results of tasks whose clouds are sent to the workers, written here where the tasks have folders.

    Raises:
        ComputationError: as `results_of`; a result cannot be written.
    """
    sent: dict[str, _Sent] = {}
    unread: list[PairResult] = []

    def loaded() -> Iterator[PairTask]:
        for task in tasks:
            read = read_pair(task)
            if read.loaded is None:
                unread.append(PairResult(task.pair.name, None, read.error))
                continue
            sent[task.pair.name] = _Sent(task, read)
            clouds, views = read.loaded.clouds, read.loaded.views
            pair = dataclasses.replace(
                task.pair,
                before=clouds.before,
                after=clouds.after,
                views_before=views.before,
                views_after=views.after,
            )
            yield dataclasses.replace(task, pair=pair, folder=None, fits=earlier_fits(task))

    for result in results_of(loaded(), pool):
        yield from _drained(unread)
        yield _written(result, sent.pop(result.name))
    yield from _drained(unread)


def _drained(results: list[PairResult]) -> Iterator[PairResult]:
    while results:
        yield results.pop(0)


def _written(result: PairResult, sent: _Sent) -> PairResult:
    """The result, in its folder where it has one."""
    task, read = sent
    if result.record is None or result.consensus is None or task.folder is None:
        return result
    assert read.loaded is not None
    seconds = {**result.record.seconds, "reading": read.seconds}
    warnings = tuple(result.record.pair.warnings.splitlines())
    found = FoundPair(result.name, read.loaded, result.consensus, seconds, warnings)
    try:
        return PairResult(result.name, write_pair(task, found, read.inputs, seconds))
    except (InputError, OSError) as error:
        raise ComputationError(f"{error}; what is done is kept: start the same command again then") from error
