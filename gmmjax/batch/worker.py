"""What a worker does with pairs: read, detect, write. Everything here can run in another process."""

import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.batch.fingerprint import Fingerprint, fingerprint_of_memory
from gmmjax.batch.pair_record import PAIR_FILE, PairRecord, Request
from gmmjax.batch.rows import ChangeRow, ConvergenceRow, PairRow
from gmmjax.batch.scan_pair import BatchPair, LoadedPair
from gmmjax.changes import Consensus, DetectionConfig, RestartFits, change_columns, detect_consensus
from gmmjax.clouds import FolderKind, output_folder
from gmmjax.errors import InputError, collected_warnings, one_line

FITS_FILE = "fits.npz"
PAIR_RESULT = FolderKind("result of a pair", PAIR_FILE, "request", (), tree=True, owned=True)


@dataclasses.dataclass(frozen=True, eq=False)
class FoundPair:
    """A pair whose changes are known, to be written.

    Attributes:
        name: of the pair.
        loaded: its clouds and views.
        consensus: the changes, and the fits that they are from. Its timings are in `seconds`.
        seconds: of the stages of the detection.
        warnings: what looked wrong but could be used.
    """

    name: str
    loaded: LoadedPair
    consensus: Consensus
    seconds: Mapping[str, float]
    warnings: tuple[str, ...]


Save: TypeAlias = Callable[[Path, FoundPair], None]
"""Writes what was found into a folder that is there, empty, for it alone."""


def save_changes(folder: Path, found: FoundPair) -> None:
    """Writes `changes.json` and `labels.npz`."""
    found.consensus.changes.save(folder)


@dataclasses.dataclass(frozen=True, eq=False)
class PairTask:
    """A pair to be detected in.

    Attributes:
        pair: where its scans are.
        config: of the detection.
        until_stable: difference of probabilities below which no more restarts are made; None: all are made.
        folder: for its result; None: the result is returned.
        save: writes the result.
        keeps_fits: whether the fits in the folder are of these scans and settings, so that only further ones are made.
        fits: such fits, where the folder is out of the worker's sight.
    """

    pair: BatchPair
    config: DetectionConfig
    until_stable: float | None = None
    folder: Path | None = None
    save: Save = save_changes
    keeps_fits: bool = False
    fits: RestartFits | None = None

    @property
    def request(self) -> Request:
        """What is asked for, apart from the scans."""
        return Request.of(self.config, self.until_stable, self.save.__name__)

    def inputs(self) -> dict[str, Path]:
        """The files that the result depends on."""
        verdict = {} if self.config.verdict is None else {"verdict": Path(self.config.verdict)}
        return {**self.pair.files(), **verdict}


class PairResult(NamedTuple):
    """What became of a pair.

    Attributes:
        name: of the pair.
        record: of what was written, or would be; None: the pair failed.
        error: why it failed.
        not_written: why the result could not be written: what ends the run, because the next one would fail, too.
        consensus: where there is no folder to write to.
    """

    name: str
    record: PairRecord | None
    error: str = ""
    not_written: str = ""
    consensus: Consensus | None = None


def detect_in_chunk(tasks: Sequence[PairTask]) -> list[PairResult]:
    """The results of some pairs, one after the other; the next one is read while one is computed."""
    use_compilation_cache()
    results = []
    with ThreadPoolExecutor(1) as reader:
        for task, reading in _read_ahead(tasks, reader):
            result = _detect(task, reading)
            results.append(result)
            if result.not_written:
                break
    return results


class ReadPair(NamedTuple):
    """A pair that was read, or why it could not be.

    Attributes:
        loaded: its clouds; None: it could not be read.
        inputs: the fingerprints of what its result depends on, by what each is to the pair.
        seconds: that it took.
        error: why it could not be read.
    """

    loaded: LoadedPair | None
    inputs: Mapping[str, Fingerprint]
    seconds: float
    error: str = ""


def _read_ahead(
    tasks: Sequence[PairTask], reader: ThreadPoolExecutor
) -> Iterator[tuple[PairTask, Callable[[], ReadPair]]]:
    ahead = [reader.submit(read_pair, task) for task in tasks[:1]]
    for number, task in enumerate(tasks):
        ahead.extend(reader.submit(read_pair, other) for other in tasks[number + 1 : number + 2])
        yield task, ahead.pop(0).result


def read_pair(task: PairTask) -> ReadPair:
    """Reads the scans of a task; whatever is wrong with them is the pair's own error."""
    began = time.perf_counter()
    try:
        inputs = {role: Fingerprint.of(file) for role, file in task.inputs().items()}
        loaded = task.pair.read()
        for role, file in task.inputs().items():
            if not inputs[role].matches(file):
                raise InputError(f"{file}: was changed while it was read; start the run again when it is complete")
        inputs.update({role: fingerprint_of_memory(own) for role, own in task.pair.in_memory().items()})
        return ReadPair(loaded, inputs, time.perf_counter() - began)
    except Exception as error:
        return ReadPair(None, {}, time.perf_counter() - began, failure(error))


def _detect(task: PairTask, reading: Callable[[], ReadPair]) -> PairResult:
    """The result of one pair; whatever is wrong with it is its own error."""
    read = reading()
    if read.loaded is None:
        return PairResult(task.pair.name, None, read.error)
    try:
        found = _found(task, read.loaded)
    except Exception as error:
        return PairResult(task.pair.name, None, failure(error))
    seconds = {"reading": read.seconds, **found.seconds}
    if task.folder is None:
        return PairResult(found.name, record_of(task, found, read.inputs, {}, seconds), consensus=found.consensus)
    try:
        return PairResult(found.name, write_pair(task, found, read.inputs, seconds))
    except (InputError, OSError) as error:
        return PairResult(found.name, None, not_written=failure(error))


def _found(task: PairTask, loaded: LoadedPair) -> FoundPair:
    began = time.perf_counter()
    with collected_warnings() as warnings:
        consensus = detect_consensus(
            *loaded.clouds,
            config=task.config,
            views_before=loaded.views.before,
            views_after=loaded.views.after,
            earlier=earlier_fits(task),
            until_stable=task.until_stable,
        )
    # What differs from one run to the next is kept apart, so that results are the same bit for bit.
    diagnostics = dict(consensus.changes.diagnostics)
    stages = diagnostics.pop("seconds")
    changes = dataclasses.replace(consensus.changes, diagnostics=diagnostics)
    seconds = {**stages, "detection": time.perf_counter() - began}
    return FoundPair(task.pair.name, loaded, dataclasses.replace(consensus, changes=changes), seconds, tuple(warnings))


def earlier_fits(task: PairTask) -> RestartFits | None:
    """The fits of an earlier run; None where there are none, or they cannot be read and are made again."""
    if task.folder is None or not task.keeps_fits:
        return task.fits
    try:
        return RestartFits.load(task.folder / FITS_FILE)
    except InputError:
        return None


def write_pair(
    task: PairTask, found: FoundPair, inputs: Mapping[str, Fingerprint], seconds: Mapping[str, float]
) -> PairRecord:
    """Writes the result of a pair, whole or not at all, in the place of an earlier one.

    Returns:
        The record that was written with it.

    Raises:
        InputError: the folder cannot be written.
    """
    assert task.folder is not None
    began = time.perf_counter()
    with output_folder(task.folder, PAIR_RESULT, overwrite=True) as staging:
        task.save(staging, found)
        found.consensus.fits.save(staging / FITS_FILE)
        files = {path.name: Fingerprint.of(path) for path in sorted(staging.iterdir())}
        writing = {"writing": time.perf_counter() - began}
        record = record_of(task, found, inputs, files, {**seconds, **writing})
        record.write(staging / PAIR_FILE)
    return record


def record_of(
    task: PairTask,
    found: FoundPair,
    inputs: Mapping[str, Fingerprint],
    files: Mapping[str, Fingerprint],
    seconds: Mapping[str, float],
) -> PairRecord:
    """The record of a pair that is done."""
    rounded = {stage: round(own, 4) for stage, own in seconds.items()}
    pair = _pair_row(task, found, sum(rounded.get(part, 0.0) for part in ("reading", "detection", "writing")))
    convergence = tuple(ConvergenceRow(found.name, *doubling) for doubling in found.consensus.convergence)
    changes, finished = _change_rows(found), round(time.time(), 3)
    return PairRecord(task.request, inputs, files, pair, changes, convergence, rounded, finished)


def _pair_row(task: PairTask, found: FoundPair, seconds: float) -> PairRow:
    changes, registration = found.consensus.changes, found.consensus.changes.registration.to_dict()
    counts, files = changes.object_counts(), task.pair.files()
    columns: dict[str, Any] = dict(counts)
    for name in ("applied", "residual", "overlap", "confidence"):
        columns[f"registration_{name}"] = registration[name]
    errors = [error for error in found.consensus.standard_errors if error is not None]
    return PairRow(
        name=found.name,
        status="done",
        before=str(files["before"]) if "before" in files else None,
        after=str(files["after"]) if "after" in files else None,
        points_before=len(changes.labels_before),
        points_after=len(changes.labels_after),
        changes=sum(counts.values()),
        highest_probability=max((change.probability for change in changes), default=None),
        restarts=found.consensus.restarts,
        standard_error=max(errors, default=None),
        settled=found.consensus.settled,
        difference=found.consensus.convergence[-1].difference if found.consensus.convergence else None,
        **columns,
        unobserved_before=float(changes.unobserved_before.mean()),
        unobserved_after=float(changes.unobserved_after.mean()),
        warnings="\n".join(found.warnings),
        seconds=round(seconds, 3),
    )


def _change_rows(found: FoundPair) -> tuple[ChangeRow, ...]:
    shared = [field.name for field in dataclasses.fields(ChangeRow) if field.name not in ("name", "standard_error")]
    return tuple(
        ChangeRow(name=found.name, standard_error=error, **{name: getattr(change, name) for name in shared})
        for change, error in zip(change_columns(found.consensus.changes), found.consensus.standard_errors, strict=True)
    )


def failure(error: BaseException) -> str:
    """Why a pair failed, in one line."""
    return str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {one_line(error)}"
