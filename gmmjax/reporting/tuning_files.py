"""Files of `gmmjax tune`: the tuned settings, and the state of a tuning that runs."""

import functools
import os
from pathlib import Path

import numpy as np
import tomli_w

from gmmjax.changes import NAMES, names_of, write_verdicts
from gmmjax.clouds import atomic_write, load_archive, require_file
from gmmjax.errors import InputError
from gmmjax.learning import CandidateRows
from gmmjax.tuning import TuningResult, TuningState, VerdictResult, VerdictState

OPTIMISER = "optimiser_"
MEASURED = "measured"
USE = "Written by gmmjax tune; use it by: gmmjax detect BEFORE AFTER --out DIR --config THIS_FILE"


def write_tuned(path: str | os.PathLike[str], result: TuningResult | VerdictResult) -> None:
    """Write the settings as TOML for `gmmjax detect --config`, and a tuned verdict beside them."""
    settings = result.config.to_dict()
    if isinstance(result, VerdictResult):
        lines = _verdict_comments(result)
        if result.improved:
            # Before the settings that name it.
            write_verdicts(verdict_file(path), result.verdicts, result.made)
            settings["verdict"] = verdict_file(path).name
    else:
        lines = _comments(result)
    with atomic_write(path) as file:
        file.write("".join(f"# {line}\n" for line in (USE, *lines)).encode())
        tomli_w.dump(settings, file)


def verdict_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a tuned verdict."""
    return Path(path).with_suffix(".verdict.json")


def _verdict_comments(result: VerdictResult) -> list[str]:
    verdict = "tuned" if result.improved else "left as it was: no better one was found"
    return [f"Verdict {verdict}.", f"Pairs: {', '.join(result.pairs)}."]


def _comments(result: TuningResult) -> list[str]:
    verdict = "tuned" if result.improved else "left as they were: tuning did not lower the loss"
    lines = [f"Settings {verdict}. Loss ({result.loss}) {result.best[0]:.6g}; untuned {result.baseline[0]:.6g}."]
    lines.append(f"Trained on {', '.join(result.training)}.")
    lines.append(f"Held back: {', '.join(result.held_back)}.")
    return lines


def progress_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of the state of an unfinished tuning."""
    return Path(path).with_suffix(".progress.npz")


def write_state(path: str | os.PathLike[str], state: TuningState | VerdictState, fingerprint: str) -> None:
    """Store the state of a tuning, and the fingerprint of what it was called with, whole or not at all."""
    arrays = _measured_arrays(state) if isinstance(state, VerdictState) else _course_arrays(state)
    with atomic_write(path) as file:
        np.savez(file, fingerprint=np.array(fingerprint), allow_pickle=False, **arrays)


def _course_arrays(state: TuningState) -> dict[str, np.ndarray]:
    arrays = {name: value for name, value in state._asdict().items() if name != "optimiser"}
    return arrays | {f"{OPTIMISER}{number:03}": leaf for number, leaf in enumerate(state.optimiser)}


def _measured_arrays(state: VerdictState) -> dict[str, np.ndarray]:
    """Gather the candidates of each pair, and how many pairs there are."""
    arrays = {MEASURED: np.array(len(state.measured))}
    for number, pair in enumerate(state.measured):
        for side, rows in zip(NAMES, pair, strict=True):
            arrays |= {f"{number}/{side}/{column}": values for column, values in rows._asdict().items()}
    return arrays


def read_state(path: str | os.PathLike[str], fingerprint: str) -> TuningState | VerdictState:
    """Read the state of an unfinished tuning.

    Raises:
        InputError: a file that is damaged, or of a tuning with other pairs or settings.
    """
    remedy = "begin anew with --restart"
    stored = load_archive(require_file(path), remedy)
    names = [] if MEASURED in stored else [name for name in TuningState._fields if name != "optimiser"]
    if missing := [name for name in ("fingerprint", *names) if name not in stored]:
        raise InputError(f"{path}: is damaged (it has no {', '.join(missing)}); {remedy}")
    if str(stored["fingerprint"]) != fingerprint:
        raise InputError(f"{path}: is of a tuning with other pairs or settings; {remedy}, or give those")
    if MEASURED in stored:
        return _measured_state(path, stored, remedy)
    leaves = tuple(stored[name] for name in sorted(stored) if name.startswith(OPTIMISER))
    state = TuningState(optimiser=leaves, **{name: stored[name] for name in names})
    if not _fits(state):
        raise InputError(f"{path}: is damaged (its arrays do not fit each other); {remedy}")
    return state


def _measured_state(path: str | os.PathLike[str], stored: dict[str, np.ndarray], remedy: str) -> VerdictState:
    try:
        numbers = range(int(stored[MEASURED]))
        return VerdictState(tuple(NAMES.map(functools.partial(_candidates, stored, number)) for number in numbers))
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path}: is damaged ({error}); {remedy}") from error


def _candidates(stored: dict[str, np.ndarray], number: int, side: str) -> CandidateRows:
    own = CandidateRows(*(stored[f"{number}/{side}/{column}"] for column in CandidateRows._fields))
    count, facts = len(own.kind), len(names_of(poses=side == NAMES.after))
    if own.values.shape != (count, facts) or any(column.shape != (count,) for column in own[1:]):
        raise ValueError("its arrays do not fit each other")
    return own


def _fits(state: TuningState) -> bool:
    """Tell whether the arrays are those of one tuning: of one number of starts, settings and steps."""
    if state.free.ndim != 2 or state.losses.ndim != 3 or not len(state.losses):
        return False
    (starts, settings), steps = state.free.shape, len(state.losses)
    shapes = {
        "free": (starts, settings),
        "racing": (starts,),
        "values": (steps, starts, settings),
        "losses": (steps, starts, 3),
        "baseline": (3,),
    }
    arrays = {name: getattr(state, name) for name in shapes}
    return all(
        own.shape == shapes[name] and own.dtype.kind == ("b" if name == "racing" else "f")
        for name, own in arrays.items()
    )
