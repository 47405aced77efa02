"""What `gmmjax tune` writes: the tuned settings, the course as a page, and where it stands while it runs."""

import os
from pathlib import Path

import numpy as np
import tomli_w

from gmmjax.clouds import atomic_write, load_archive, require_file
from gmmjax.errors import InputError
from gmmjax.reporting.tuning_plot import tuning_html
from gmmjax.tuning import TuningResult, TuningState

OPTIMISER = "optimiser_"


def write_tuned(path: str | os.PathLike[str], result: TuningResult) -> Path:
    """Writes the settings as TOML for `gmmjax detect --config`, and the course as HTML beside it.

    Args:
        path: of the TOML file.
        result: of `tune`.

    Returns:
        The HTML file.

    Raises:
        InputError: a file that cannot be written.
    """
    page = Path(path).with_suffix(".html")
    with atomic_write(page) as file:
        file.write(tuning_html(result).encode())
    with atomic_write(path) as file:
        file.write("".join(f"# {line}\n" for line in _comments(result)).encode())
        tomli_w.dump(result.config.to_dict(), file)
    return page


def _comments(result: TuningResult) -> list[str]:
    lines = ["Written by gmmjax tune; use it by: gmmjax detect BEFORE AFTER --out DIR --config THIS_FILE"]
    verdict = "tuned" if result.improved else "left as they were: tuning did not lower the loss"
    lines.append(f"Settings {verdict}. Loss ({result.loss}) {result.best[0]:.6g}; untuned {result.baseline[0]:.6g}.")
    lines.append(f"Trained on {', '.join(result.training)}.")
    lines.append(f"Held back: {', '.join(result.held_back)}.")
    return lines


def progress_file(path: str | os.PathLike[str]) -> Path:
    """Where the state of an unfinished tuning lies."""
    return Path(path).with_suffix(".progress.npz")


def write_state(path: str | os.PathLike[str], state: TuningState, fingerprint: str) -> None:
    """Stores the state of a tuning, whole or not at all.

    Args:
        path: an NPZ file.
        state: of `tune`.
        fingerprint: what the tuning was called with.
    """
    arrays = {name: value for name, value in state._asdict().items() if name != "optimiser"}
    leaves = {f"{OPTIMISER}{number:03}": leaf for number, leaf in enumerate(state.optimiser)}
    with atomic_write(path) as file:
        np.savez(file, fingerprint=np.array(fingerprint), allow_pickle=False, **arrays, **leaves)


def read_state(path: str | os.PathLike[str], fingerprint: str) -> TuningState:
    """The state of an unfinished tuning.

    Raises:
        InputError: a file that is damaged, or of a tuning with other pairs or settings.
    """
    remedy = "begin anew with --restart"
    stored = load_archive(require_file(path), remedy)
    names = [name for name in TuningState._fields if name != "optimiser"]
    if missing := [name for name in ("fingerprint", *names) if name not in stored]:
        raise InputError(f"{path}: is damaged (it has no {', '.join(missing)}); {remedy}")
    if str(stored["fingerprint"]) != fingerprint:
        raise InputError(f"{path}: is of a tuning with other pairs or settings; {remedy}, or give those")
    leaves = tuple(stored[name] for name in sorted(stored) if name.startswith(OPTIMISER))
    state = TuningState(optimiser=leaves, **{name: stored[name] for name in names})
    if not _fits(state):
        raise InputError(f"{path}: is damaged (its arrays do not fit each other); {remedy}")
    return state


def _fits(state: TuningState) -> bool:
    """Whether the arrays are those of one tuning: of one number of starts, settings and steps."""
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
    kinds = {name: "b" if name == "racing" else "f" for name in shapes}
    arrays = {name: getattr(state, name) for name in shapes}
    return all(values.shape == shapes[name] and values.dtype.kind == kinds[name] for name, values in arrays.items())
