"""`gmmjax batch MANIFEST --out DIR`."""

import contextlib
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gmmjax.changes import DetectionConfig
from gmmjax.cli.detect import read_settings
from gmmjax.errors import ComputationError, InputError

if TYPE_CHECKING:
    from gmmjax.batch import BatchPair, RunFolder, RunRecord, Shard
    from gmmjax.reporting.batch_files import Summary
    from gmmjax.reporting.batch_progress import BatchProgress

# What `--help` shows.
COMMON = (
    *("manifest", "out", "overwrite", "pairs", "series", "workers", "scheduler", "shard", "merge"),
    *("until_stable", "restarts", "fail_fast", "transform_after", "config", "quiet"),
)
SERIES_FILES = {
    "timeline.html": "when each object came, moved and went",
    "objects.csv": "a row for each event of an object",
}
SUMMARY_FILES = {
    "index.html": "all pairs, to sort and search",
    "pairs.csv": "a row for each pair",
    "changes.csv": "a row for each change",
    "pairs": "a folder for each pair, with its report",
}


def batch(
    manifest: Annotated[Path | None, "MANIFEST"] = None,
    *,
    out: Annotated[Path, "DIR"],
    pairs: Annotated[str | None, "'FOLDERS/*/'"] = None,
    config: Annotated[Path | None, "FILE.toml"] = None,
    workers: int | None = None,
    scheduler: Annotated[str | None, "tcp://HOST:PORT"] = None,
    shard: Annotated[str | None, "K/N"] = None,
    merge: bool = False,
    series: bool = False,
    until_stable: bool = False,
    fail_fast: bool = False,
    transform_after: bool = False,
    overwrite: bool = False,
    quiet: bool = False,
    settings: Annotated[dict[str, Any], DetectionConfig],
) -> int:
    """Find what changed in many pairs of scans: a result for each, tables of all, and a page to browse them.

    The manifest is a table, .csv or .tsv, with the columns name, before and after, and optionally views_before,
    views_after, config, or any setting by its name. Paths in it are relative to it. The same command resumes an
    interrupted run, and computes again what was made otherwise.

    Args:
        manifest: table of the pairs.
        out: folder for the run; created if missing.
        pairs: in place of a manifest, folders that each have before.* and after.*, and optionally before_views.json
            and after_views.json.
        config: settings for all pairs; options override them.
        workers: processes of this machine. Default: one a core.
        scheduler: address of a Dask scheduler, whose workers compute in their place.
        shard: compute a part of the run, such as 3/100; the others are computed elsewhere, into the same folder.
        merge: compute nothing; write the tables and the page for what is in the folder, such as after all shards.
        series: the manifest lists the epochs of one place in order: name, cloud, and optionally views. Each is
            compared with its predecessor, and the changes are linked into objects with a history.
        until_stable: for each pair, stop when doubling the restarts changes no probability by one percent or more;
            `restarts` is then the maximum.
        fail_fast: stop at the first failure.
        transform_after: write the after scans in the frames of the before scans; by default they keep their own.
        overwrite: replace the results of a run with other settings.
        quiet: print nothing but errors.
        settings: settings that a --config file may have, too, with _ for -.
    """
    from gmmjax.batch import Shard, detect_many, detect_series, read_epochs, run_folder
    from gmmjax.reporting.batch_files import save_report, save_transformed_report
    from gmmjax.reporting.batch_progress import batch_progress

    detection = read_settings(config, settings)
    part = None if shard is None else Shard.parse(shard)
    if merge:
        return _merge(out, part, quiet=quiet)
    options: dict[str, Any] = {
        "out": out,
        "config": detection,
        "until_stable": 0.01 if until_stable else None,
        "workers": workers,
        "scheduler": scheduler,
        "save": save_transformed_report if transform_after else save_report,
        "overwrite": overwrite,
        "fail_fast": fail_fast,
    }
    if series:
        if part is not None or manifest is None:
            raise InputError("--series needs a MANIFEST of epochs, and goes without --pairs and --shard")
        epochs = read_epochs(manifest, detection)
        results, count = detect_series(epochs, **options), len(epochs) - 1
    else:
        given = _pairs(manifest, pairs, detection)
        results, count = detect_many(given, shard=part, **options), len(given if part is None else part.of(given))
    try:
        with batch_progress(count, quiet=quiet) as progress:
            for result in results:
                progress.count(done=result.done, reused=result.reused)
    except (KeyboardInterrupt, ComputationError):
        results.close()
        if part is None:
            # What is done so far can be looked at; why the run ended is what the user must read.
            with contextlib.suppress(InputError):
                _summary(run_folder(out))
        raise
    if part is not None:
        return _shard_done(out, progress, quiet=quiet)
    return _summarised(run_folder(out), quiet=quiet)


def _pairs(manifest: Path | None, pattern: str | None, config: DetectionConfig) -> "list[BatchPair]":
    from gmmjax.batch import pairs_in_folders, read_manifest

    if (manifest is None) == (pattern is None):
        raise InputError("give a MANIFEST, or folders by --pairs 'FOLDERS/*/', and not both")
    return read_manifest(manifest, config) if manifest is not None else pairs_in_folders(str(pattern))


def _merge(out: Path, part: "Shard | None", *, quiet: bool) -> int:
    """Tables and page of what is in the folder."""
    from gmmjax.batch import RUN_FILE, run_folder

    if part is not None:
        raise InputError("--merge is of all shards; leave --shard out")
    if not (out / RUN_FILE).is_file():
        raise InputError(f"--out {out}: holds no run (no {RUN_FILE}); give the folder that the shards were computed in")
    return _summarised(run_folder(out), quiet=quiet)


def _summarised(folder: "RunFolder", *, quiet: bool) -> int:
    """Writes the summary, and the history of a series; 1 where pairs failed or are missing."""
    from gmmjax.reporting import console
    from gmmjax.reporting.batch_files import write_history
    from gmmjax.reporting.timeline_page import series_answer

    record, summary = _summary(folder)
    files = SUMMARY_FILES
    if record.series is not None:
        answer = series_answer(record.epochs, write_history(folder))
        files = {**SERIES_FILES, **SUMMARY_FILES}
    if not quiet:
        console.print_batch(summary, heading=None if record.series is None else answer)
        console.print_files(folder.path, files)
        console.print_report_hint(folder.path / next(iter(files)))
    return 1 if summary.failed or summary.missing else 0


def _summary(folder: "RunFolder") -> "tuple[RunRecord, Summary]":
    from gmmjax.reporting.batch_files import write_summary

    record = folder.run_record()
    if record is None:
        raise InputError(f"{folder.path}: holds no run yet; nothing was computed")
    return record, write_summary(folder, record.names)


def _shard_done(out: Path, progress: "BatchProgress", *, quiet: bool) -> int:
    if not quiet:
        print(f"{progress.counts}; when all shards are: gmmjax batch --merge --out {shlex.quote(str(out))}")
    return 1 if progress.failed else 0
