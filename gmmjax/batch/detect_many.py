"""Many pairs of scans from Python: an iterator of results, as they are done."""

import dataclasses
import os
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from gmmjax.batch.driver import results_of
from gmmjax.batch.pools import Workers
from gmmjax.batch.rows import ChangeRow, PairRow
from gmmjax.batch.run_folder import RunFolder, RunRecord, Shard, run_folder
from gmmjax.batch.scan_pair import BatchPair, check_distinct
from gmmjax.batch.worker import PairResult, PairTask, Save, recorded, save_changes
from gmmjax.changes import Changes, DetectionConfig
from gmmjax.errors import ComputationError, InputError, shown


@dataclasses.dataclass(frozen=True, eq=False)
class BatchResult:
    """The result of a pair.

    Attributes:
        name: of the pair.
        pair: its row of the summary; `pair.error` says why it failed, and is empty where it did not.
        change_rows: the rows of its changes.
        folder: of its result; None: it is in memory, or the pair failed.
        reused: whether it was there from an earlier run.
    """

    name: str
    pair: PairRow
    change_rows: tuple[ChangeRow, ...] = ()
    folder: Path | None = None
    reused: bool = False
    _changes: Changes | None = None

    @property
    def done(self) -> bool:
        """True where the pair has a result."""
        return self.pair.status == "done"

    def changes(self) -> Changes:
        """The changes; read from the folder where they are not in memory.

        Raises:
            ComputationError: the pair failed.
            InputError: the files are missing or damaged.
        """
        if not self.done:
            raise ComputationError(f"pair {self.name}: failed ({self.pair.error})")
        if self._changes is not None:
            return self._changes
        assert self.folder is not None
        return Changes.load(self.folder)


def detect_many(
    pairs: Iterable[BatchPair],
    *,
    out: str | os.PathLike[str] | None = None,
    config: DetectionConfig | None = None,
    until_stable: float | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | None = None,
    capacity: int | None = None,
    shard: Shard | None = None,
    record: RunRecord | None = None,
    save: Save = save_changes,
    overwrite: bool = False,
    fail_fast: bool = False,
) -> Generator[BatchResult, None, None]:
    """Detects the changes of many pairs of scans in other processes, and gives each result as soon as it is done.

    With `out` every result is written when it is done; started again the function computes what is missing, and what
    was made of other scans, with other settings or by another version. Results are the same bit for bit whatever the
    number of workers, and however often the run was interrupted.

    A script that calls it needs `if __name__ == "__main__":`, as for every function that starts processes.

    Args:
        pairs: the pairs; a sequence is computed in the order of its files' sizes, so that pairs of like sizes meet the
            same compiled programs, and any other iterable as it comes.
        out: folder of the run; None: results are in memory.
        config: settings of all pairs that have none of their own; default `DetectionConfig()`.
        until_stable: no more restarts are made for a pair when doubling them changes the probability of no change by
            more than this; `restarts` is then the most. None: all are made.
        workers: processes on this machine; None: one a core.
        scheduler: address of a Dask scheduler, such as tcp://10.0.0.1:8786, whose workers compute in place of processes
            of this machine. They read and write the files by the same paths.
        executor: any other `concurrent.futures.Executor` in their place.
        capacity: pairs that an `executor` is given before the first one is done: more than it has workers.
        shard: the part of the run that is computed; the others are computed elsewhere. None: all.
        record: what the folder is told to be of, where these pairs are a part of it; None: of these pairs.
        save: writes the result of a pair into its folder.
        overwrite: whether `out` may be of a run with other settings, whose results are replaced.
        fail_fast: whether the first pair that fails ends the run.

    Yields:
        A result for each pair, those that are there already first. A pair that fails has a result that says why.

    Raises:
        InputError: pairs of one name, a folder that cannot be used, or that another run is using.
        ComputationError: the workers are lost, results cannot be written, or a pair failed and `fail_fast`.
    """
    place, config = Workers(workers, scheduler, executor, capacity), config or DetectionConfig()
    if shard is not None and out is None:
        raise InputError("shard needs out: the parts of a run meet in its folder")
    _check_until_stable(until_stable, config)
    if out is not None or isinstance(pairs, Sequence):
        pairs = list(pairs)
        check_distinct([pair.name for pair in pairs], "pairs")
    folder = None if out is None else RunFolder(Path(os.path.abspath(out)))
    tasks = (_task(pair, config, until_stable, folder, save) for pair in pairs)
    if folder is None:
        count = len(pairs) if isinstance(pairs, list) else None
        return _computed(tasks, place, folder, count, fail_fast=fail_fast)
    record = record or RunRecord.of([pair.name for pair in pairs], config)
    return _in_folder(list(tasks), folder, record, shard, place, overwrite=overwrite, fail_fast=fail_fast)


def _check_until_stable(until_stable: float | None, config: DetectionConfig) -> None:
    if until_stable is None:
        return
    if not 0 < until_stable < 1:
        raise InputError(f"until_stable={until_stable} must lie between 0 and 1")
    if config.restarts is None:
        raise InputError("until_stable needs restarts, the most that are made, such as restarts=64")


def _task(
    pair: BatchPair, config: DetectionConfig, until_stable: float | None, folder: RunFolder | None, save: Save
) -> PairTask:
    """The task of a pair. Its paths are absolute: a worker may be started in another folder."""
    files: dict[str, Any] = {role: Path(os.path.abspath(file)) for role, file in pair.files().items()}
    own = pair.config or config
    if own.verdict is not None:
        own = dataclasses.replace(own, verdict=os.path.abspath(own.verdict))
    place = None if folder is None else folder.pair(pair.name)
    return PairTask(dataclasses.replace(pair, **files), own, until_stable, place, save)


def _in_folder(
    tasks: list[PairTask],
    folder: RunFolder,
    record: RunRecord,
    shard: Shard | None,
    place: Workers,
    *,
    overwrite: bool,
    fail_fast: bool,
) -> Generator[BatchResult, None, None]:
    """Results that are there, then those computed, largest first: like sizes meet the same compiled programs."""
    run_folder(folder.path)
    with folder.locked(shard):
        folder.prepare(record, overwrite=overwrite)
        waiting = []
        for task in tasks if shard is None else shard.of(tasks):
            known = recorded(task)
            if known is None:
                waiting.append(task)
            else:
                folder.clear_error(task.pair.name)
                yield BatchResult(task.pair.name, known.pair, known.changes, task.folder, reused=True)
        waiting.sort(key=_size, reverse=True)
        if waiting:
            yield from _computed(iter(waiting), place, folder, len(waiting), fail_fast=fail_fast)


def _computed(
    tasks: Iterator[PairTask], place: Workers, folder: RunFolder | None, count: int | None, *, fail_fast: bool
) -> Generator[BatchResult, None, None]:
    known: dict[str, PairTask] = {}
    for result in results_of(_remembered(tasks, known), place.pool(count)):
        task = known[result.name]
        # Without the clouds, which may be in memory: only the name must not come again.
        known[result.name] = dataclasses.replace(task, pair=BatchPair(result.name, "", ""))
        yield _kept(result, task, folder)
        if result.record is None and fail_fast:
            raise ComputationError(f"pair {result.name}: {result.error}")


def _remembered(tasks: Iterator[PairTask], known: dict[str, PairTask]) -> Iterator[PairTask]:
    for task in tasks:
        if task.pair.name in known:
            raise InputError(f"pairs: the name {shown(task.pair.name)} is there more than once")
        known[task.pair.name] = task
        yield task


def _kept(result: PairResult, task: PairTask, folder: RunFolder | None) -> BatchResult:
    """The result for the caller; why a pair failed is written, too."""
    if result.record is not None:
        if folder is not None:
            folder.clear_error(result.name)
        changes = None if result.consensus is None else result.consensus.changes
        return BatchResult(result.name, result.record.pair, result.record.changes, task.folder, _changes=changes)
    files = {role: str(file) for role, file in task.pair.files().items()}
    row = PairRow(result.name, "failed", result.error, files.get("before"), files.get("after"))
    if folder is not None:
        folder.write_error(row)
    return BatchResult(result.name, row)


def _size(task: PairTask) -> int:
    """Bytes of the scans of a pair, about what it takes."""
    clouds = [getattr(cloud, "points", cloud) for cloud in task.pair.clouds]
    in_memory = sum(getattr(cloud, "nbytes", 0) for cloud in clouds)
    return in_memory + sum(file.stat().st_size for file in task.pair.files().values() if file.is_file())
