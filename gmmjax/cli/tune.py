"""`gmmjax tune FOLDER --out tuned.toml`."""

import dataclasses
import functools
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.changes import DetectionConfig
from gmmjax.cli.detect import read_settings
from gmmjax.cli.options import check_output_file
from gmmjax.tuning import TuningSettings

if TYPE_CHECKING:
    from gmmjax.tuning import ScanPair, TuningState, VerdictState


# What `--help` shows.
COMMON = ("folder", "out", "overwrite", "unchanged", "parameters", "config", "steps", "seed", "restart", "quiet")


def tune(
    folder: Annotated[Path, "FOLDER"],
    *,
    out: Annotated[Path, "FILE.toml"],
    config: Annotated[Path | None, "FILE.toml"] = None,
    unchanged: bool = False,
    overwrite: bool = False,
    restart: bool = False,
    quiet: bool = False,
    json: bool = False,
    settings: Annotated[dict[str, Any], TuningSettings],
) -> int:
    """Tune detection by gradient on pairs of scans; the result is a file for detect --config.

    Each pair is a folder with before.* and after.* (any format that detect reads), and truth_before.npy and
    truth_after.npy as for "gmmjax evaluate pairs". On scans the verdict is tuned, by which a difference is a change. Of
    clouds that fill volumes, and where no pair has truth, settings of the mixture are tuned, without truth by the
    likelihood of held-out points. The same command resumes an interrupted tuning.

    Args:
        folder: folder that holds one folder for each pair.
        out: file for the settings; the course of the tuning is written next to it, as PNG, and so is a tuned verdict.
        config: settings to start from; those that are not tuned are kept.
        unchanged: nothing changed in the pairs without truth: what is reported there is a false alarm.
        overwrite: replace the output files.
        restart: start again in place of resuming an interrupted tuning.
        quiet: print nothing but errors.
        json: print the result as JSON and nothing else.
        settings: settings of the tuning.
    """
    from gmmjax import tuning
    from gmmjax.plotting import tuning_figure, write_figure
    from gmmjax.reporting import console, tuning_files

    chosen, given = TuningSettings(**settings), read_settings(config)
    beside = (out.with_suffix(".png"), out.with_suffix(".verdict.json"))
    check_output_file("--out", out, (".toml",), others=beside, overwrite=overwrite)
    use_compilation_cache()
    state_file = tuning_files.progress_file(out)
    with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
        progress("Reading the pairs", 0.0)
        pairs = tuning.find_tuning_pairs(folder, unchanged=unchanged)
        fingerprint = _fingerprint(pairs, given, chosen)
        resume = tuning_files.read_state(state_file, fingerprint) if state_file.exists() and not restart else None
        if resume is not None and not quiet:
            console.print_note(f"Going on after {_place(resume)} of {state_file}.")
        result = tuning.tune(
            pairs,
            config=given,
            settings=chosen,
            resume=resume,
            checkpoint=functools.partial(_checkpoint, state_file, fingerprint),
            progress=progress,
        )
    picture = out.with_suffix(".png")
    write_figure(picture, tuning_figure(result))
    tuning_files.write_tuned(out, result)
    state_file.unlink(missing_ok=True)
    if json:
        console.print_json(result)
    elif not quiet:
        console.print_tuning(result, out, picture)
    return 0


def _place(state: "TuningState | VerdictState") -> str:
    """Where an unfinished tuning stands."""
    from gmmjax.tuning import VerdictState

    return f"pair {len(state.measured)}" if isinstance(state, VerdictState) else f"step {state.steps}"


def _checkpoint(file: Path, fingerprint: str, state: "TuningState | VerdictState") -> None:
    from gmmjax.reporting import tuning_files

    tuning_files.write_state(file, state, fingerprint)


def _fingerprint(pairs: "Sequence[ScanPair]", config: DetectionConfig, settings: TuningSettings) -> str:
    """Hash all that a tuning depends on, but the number of its steps."""
    from gmmjax.changes import names_of

    about = [
        sorted(config.to_dict().items()),
        sorted((name, value) for name, value in dataclasses.asdict(settings).items() if name != "steps"),
        names_of(poses=True),
        [(pair.name, len(pair.before), len(pair.after), pair.labelled) for pair in pairs],  # type: ignore[arg-type]
    ]
    return hashlib.sha256(repr(about).encode()).hexdigest()
