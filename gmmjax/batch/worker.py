"""A pair in a worker, which may be another process: read, detect, write."""

import dataclasses
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.batch.fingerprint import Fingerprint, fingerprint_of_memory
from gmmjax.batch.pair_record import PAIR_FILE, PairRecord, Request
from gmmjax.batch.rows import ChangeRow, PairRow
from gmmjax.batch.scan_pair import BatchPair
from gmmjax.changes import Consensus, DetectionConfig, RestartFits, change_columns, detect_consensus
from gmmjax.clouds import FolderKind, PointCloud, SensorViews, output_folder
from gmmjax.errors import InputError, collected_warnings, one_line
from gmmjax.pair import Pair

FITS_FILE = "fits.npz"
PAIR_RESULT = FolderKind("result of a pair", PAIR_FILE, "request", (), tree=True, owned=True)
Inputs: TypeAlias = Mapping[str, Fingerprint]


@dataclasses.dataclass(frozen=True, eq=False)
class FoundPair:
    """A pair whose changes are known, to be written.

    Attributes:
        name: of the pair.
        clouds: both clouds.
        consensus: the changes, and the fits that they are from. Its timings are in `seconds`.
        seconds: of reading, and of the stages of the detection.
        warnings: what looked wrong but could be used.
    """

    name: str
    clouds: Pair[PointCloud]
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
    """

    pair: BatchPair
    config: DetectionConfig
    until_stable: float | None = None
    folder: Path | None = None
    save: Save = save_changes

    @property
    def request(self) -> Request:
        """The request, apart from the scans."""
        return Request.of(self.config, self.until_stable, self.save.__name__)

    def inputs(self) -> dict[str, Path]:
        """The files that the result depends on."""
        verdict = {} if self.config.verdict is None else {"verdict": Path(self.config.verdict)}
        return {**self.pair.files(), **verdict}

    def in_memory(self) -> dict[str, Fingerprint]:
        """The fingerprints of the scans and views that were given themselves."""
        return {role: fingerprint_of_memory(own) for role, own in self.pair.in_memory().items()}


class PairResult(NamedTuple):
    """The result of a pair.

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


def recorded(task: PairTask) -> PairRecord | None:
    """The record of a pair that is done as the task asks for it; None where it is not."""
    record = _record_in_folder(task)
    if record is None or task.folder is None or record.request != task.request:
        return None
    made_so = record.is_of({**task.inputs(), **task.in_memory()}) and record.is_whole(task.folder)
    return record if made_so else None


def detect_pair(task: PairTask) -> PairResult:
    """Reads a pair, detects its changes, and writes them; whatever is wrong with the pair is its own error."""
    use_compilation_cache()
    try:
        found, inputs = _found(task)
    except Exception as error:
        return PairResult(task.pair.name, None, failure(error))
    if task.folder is None:
        return PairResult(found.name, _record(task, found, inputs, {}, 0.0), consensus=found.consensus)
    try:
        return PairResult(found.name, _written(task, task.folder, found, inputs))
    except (InputError, OSError) as error:
        return PairResult(found.name, None, not_written=failure(error))


def failure(error: BaseException) -> str:
    """Why a pair failed, in one line."""
    return str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {one_line(error)}"


def _found(task: PairTask) -> tuple[FoundPair, Inputs]:
    """The changes of a pair, and the fingerprints of what they were made from."""
    began = time.perf_counter()
    clouds, views, inputs = _read(task)
    read = time.perf_counter()
    with collected_warnings() as warnings:
        consensus = detect_consensus(
            *clouds,
            config=task.config,
            views_before=views.before,
            views_after=views.after,
            earlier=_earlier_fits(task, inputs),
            until_stable=task.until_stable,
        )
    # What differs from one run to the next is kept apart, so that results are the same bit for bit.
    diagnostics = dict(consensus.changes.diagnostics)
    seconds = {"reading": read - began, **diagnostics.pop("seconds"), "detection": time.perf_counter() - read}
    changes = dataclasses.replace(consensus.changes, diagnostics=diagnostics)
    consensus = dataclasses.replace(consensus, changes=changes)
    return FoundPair(task.pair.name, clouds, consensus, seconds, tuple(warnings)), inputs


def _read(task: PairTask) -> tuple[Pair[PointCloud], Pair[SensorViews | None], Inputs]:
    files = task.inputs()
    inputs = {role: Fingerprint.of(file) for role, file in files.items()}
    clouds, views = task.pair.read()
    for role, file in files.items():
        if not inputs[role].matches(file):
            raise InputError(f"{file}: was changed while it was read; start the run again when it is complete")
    return clouds, views, {**inputs, **task.in_memory()}


def _record_in_folder(task: PairTask) -> PairRecord | None:
    try:
        return None if task.folder is None else PairRecord.read(task.folder / PAIR_FILE)
    except InputError:
        return None


def _earlier_fits(task: PairTask, inputs: Inputs) -> RestartFits | None:
    """The fits of an earlier run of the same scans and settings; None where there are none that can be read."""
    record = _record_in_folder(task)
    if record is None or task.folder is None or FITS_FILE not in record.files:
        return None
    if record.request.settings != task.request.settings or not record.is_of(inputs):
        return None
    file = task.folder / FITS_FILE
    try:
        return RestartFits.load(file) if record.files[FITS_FILE].matches(file) else None
    except InputError:
        return None


def _written(task: PairTask, folder: Path, found: FoundPair, inputs: Inputs) -> PairRecord:
    """Writes the result of a pair, whole or not at all, in the place of an earlier one."""
    began = time.perf_counter()
    with output_folder(folder, PAIR_RESULT, overwrite=True) as staging:
        task.save(staging, found)
        found.consensus.fits.save(staging / FITS_FILE)
        files = {path.name: Fingerprint.of(path) for path in sorted(staging.iterdir())}
        record = _record(task, found, inputs, files, time.perf_counter() - began)
        record.write(staging / PAIR_FILE)
    return record


def _record(task: PairTask, found: FoundPair, inputs: Inputs, files: Inputs, writing: float) -> PairRecord:
    seconds = {stage: round(own, 4) for stage, own in {**found.seconds, "writing": writing}.items()}
    pair = _pair_row(task, found, seconds["reading"] + seconds["detection"] + seconds["writing"])
    return PairRecord(task.request, inputs, files, pair, _change_rows(found), seconds, round(time.time(), 3))


def _pair_row(task: PairTask, found: FoundPair, seconds: float) -> PairRow:
    consensus, changes = found.consensus, found.consensus.changes
    registration, counts, files = changes.registration.to_dict(), changes.object_counts(), task.pair.files()
    columns: dict[str, Any] = dict(counts)
    for name in ("applied", "residual", "overlap", "confidence"):
        columns[f"registration_{name}"] = registration[name]
    errors = [error for error in consensus.standard_errors if error is not None]
    return PairRow(
        name=found.name,
        status="done",
        before=str(files["before"]) if "before" in files else None,
        after=str(files["after"]) if "after" in files else None,
        points_before=len(changes.labels_before),
        points_after=len(changes.labels_after),
        changes=sum(counts.values()),
        highest_probability=max((change.probability for change in changes), default=None),
        restarts=consensus.restarts,
        standard_error=max(errors, default=None),
        settled=consensus.settled,
        difference=consensus.convergence[-1].difference if consensus.convergence else None,
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
