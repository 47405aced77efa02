"""Mixtures on disk: `mixture.json` for people and scripts, `mixture.npz` with the same arrays."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds import FolderKind, atomic_write, check_output_folder, output_folder, read_json_record
from gmmjax.errors import InputError, one_line
from gmmjax.mixtures import Fit, FitStatus, GaussianMixture

SCHEMA_VERSION = 1
MIXTURE_FILE = "mixture.json"
ARRAYS_FILE = "mixture.npz"
MIXTURE = FolderKind("mixture", MIXTURE_FILE, "weights", (ARRAYS_FILE,))

_ARRAYS = ("weights", "means", "covariances")


def check_mixture_folder(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Raise an InputError unless `write_mixture` could write there, before a long computation."""
    check_output_folder(folder, MIXTURE, overwrite=overwrite)


def write_mixture(
    folder: str | os.PathLike[str],
    fit: Fit,
    *,
    source: str | None = None,
    settings: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write the live components of a fit as `mixture.json` and `mixture.npz`: both or none.

    Args:
        folder: is made where needed; may be empty.
        fit: one fit, without an axis of restarts.
        source: the file that was fitted.
        settings: how, as plain values.
        overwrite: replace a previous mixture.

    Returns:
        The folder.

    Raises:
        InputError: a folder that cannot be written; it is then as it was.
    """
    mixture = fit.mixture.live_part()
    arrays = {name: np.asarray(getattr(mixture, name), np.float64) for name in _ARRAYS}
    content = {
        "schema_version": SCHEMA_VERSION,
        "source": source,
        "components": len(arrays["weights"]),
        **{name: values.tolist() for name, values in arrays.items()},
        "message_length": float(fit.message_length),
        "log_likelihood": float(fit.log_likelihood),
        "steps": int(fit.steps),
        "status": _status_name(fit),
        "settings": dict(settings or {}),
    }
    text = json.dumps(content, indent=2, allow_nan=False)
    with output_folder(folder, MIXTURE, overwrite=overwrite) as staging:
        with atomic_write(staging / ARRAYS_FILE) as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        with atomic_write(staging / MIXTURE_FILE) as file:
            file.write(text.encode())
    return Path(folder)


def read_mixture(path: str | os.PathLike[str]) -> GaussianMixture:
    """The mixture that `write_mixture` wrote: all slots live, float64.

    Args:
        path: the folder, or its `mixture.json`.

    Raises:
        InputError: a file that is missing, damaged, or of another schema version.
    """
    file = Path(path)
    if file.is_dir():
        file = file / MIXTURE_FILE
    content = read_json_record(file, SCHEMA_VERSION, "run the fit again")
    try:
        arrays = {name: np.array(content[name], np.float64) for name in _ARRAYS}
        _check_mixture(**arrays)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{file}: is not a complete mixture ({type(error).__name__}: {one_line(error)}); run the fit again"
        ) from error
    return GaussianMixture(**arrays, live=np.ones(len(arrays["weights"]), bool))


def _status_name(fit: Fit) -> str:
    names = ("converged", "step_limit", "not_finite", "not_at_rest", "invalid_input")
    return next(name for name in names if bool(fit.result == getattr(FitStatus, name)))


def _check_mixture(weights: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> None:
    if means.ndim != 2 or not means.size:
        raise ValueError(f"means {list(means.shape)} are not [K, d]")
    count, dimension = means.shape
    if weights.shape != (count,) or covariances.shape != (count, dimension, dimension):
        raise ValueError(f"weights {weights.shape}, means {means.shape} and covariances {covariances.shape} disagree")
    if not all(np.isfinite(values).all() for values in (weights, means, covariances)):
        raise ValueError("a number that is not finite")
    if (weights <= 0).any() or abs(weights.sum() - 1) > 1e-3:
        raise ValueError("weights that are not positive, or do not add up to 1")
    np.linalg.cholesky(covariances)
    if np.abs(covariances - covariances.swapaxes(1, 2)).max() > 1e-6 * np.abs(covariances).max():
        raise ValueError("a covariance that is not symmetric")
