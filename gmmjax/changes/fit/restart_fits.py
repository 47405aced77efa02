"""The fits of a detection's restarts as one record, which can be kept in a file and which more can be added to."""

import dataclasses
import os
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import jax
import numpy as np

from gmmjax.clouds import atomic_write, load_archive, require_file
from gmmjax.errors import InputError, one_line, shown
from gmmjax.mixtures import FitStatus, GaussianMixture, failed, stacked

Tree = TypeVar("Tree")

# Kind of number and shape of one restart's part of each array; k is the number of slots of the mixtures.
Layout = Mapping[str, tuple[str, str]]
MIXTURE: Layout = {"weights": ("f", "k"), "means": ("f", "k3"), "covariances": ("f", "k33"), "live": ("b", "k")}
SCORES: Layout = {"message_length": ("f", ""), "steps": ("i", ""), "result": ("i", "")}
JOINT: Layout = {
    **MIXTURE,
    **SCORES,
    **{"share_after": ("f", "k"), "noise_weight": ("f", ""), "log_noise": ("f", ""), "density_ratio": ("f", "")},
}
ONE_CLOUD: Layout = {
    **MIXTURE,
    **SCORES,
    **{"log_likelihood": ("f", ""), "bits": ("i", ""), "noise_share": ("f", "")},
}
SEPARATE: Layout = {f"{name}_{time}": part for time in ("before", "after") for name, part in ONE_CLOUD.items()}


@dataclasses.dataclass(frozen=True, eq=False)
class RestartFits:
    """The fits of all restarts of a detection that were computed, in their order; `len` is their number.

    A restart is the same whatever the number of restarts, so that the fits of a detection with few of them are the
    first ones of a detection with more. They are of one pair of clouds and one set of settings; which these are is for
    the caller to know.

    Attributes:
        method: of the detection.
        arrays: by name, each with a leading axis of restarts; those without a mixture too, as their `result` says.
            Empty: of no restart.
    """

    method: str
    arrays: Mapping[str, np.ndarray]

    def __post_init__(self) -> None:
        """Checks the arrays.

        Raises:
            ValueError: they are not the fits of restarts.
        """
        if not self.arrays:
            return
        layout = JOINT if "share_after" in self.arrays else SEPARATE
        for name in sorted(set(layout) ^ set(self.arrays)):
            raise ValueError(f"has {'no' if name in layout else 'an unknown'} array {name}")
        slots = self.arrays[next(iter(layout))].shape[1:2]
        for name, (kind, shape) in layout.items():
            _check_array(name, self.arrays[name], kind, (len(self), *_sizes(shape, slots)))
        for time in ("",) if layout is JOINT else ("_before", "_after"):
            _check_finite({name: values for name, values in self.arrays.items() if name.endswith(time)}, time)

    def __len__(self) -> int:
        return next((values.shape[0] for values in self.arrays.values() if values.ndim), 0)

    @property
    def slots(self) -> int:
        """Of the mixtures, live or not."""
        return next((values.shape[1] for name, values in self.arrays.items() if name.startswith("weights")), 0)

    def first(self, restarts: int) -> "RestartFits":
        """The fits of the first restarts, or of all where there are no more.

        Args:
            restarts: how many.
        """
        return RestartFits(self.method, {name: values[:restarts] for name, values in self.arrays.items()})

    def followed_by(self, more: "RestartFits") -> "RestartFits":
        """These fits, and those of the restarts that come next."""
        if not self.arrays:
            return more
        both = {name: np.concatenate([values, more.arrays[name]]) for name, values in self.arrays.items()}
        return RestartFits(self.method, both)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes an .npz file.

        Args:
            path: the file; one that is there is replaced.

        Raises:
            InputError: the file cannot be written.
        """
        try:
            with atomic_write(path) as file:
                np.savez_compressed(file, method=np.array(self.method), **self.arrays)  # type: ignore[arg-type]
        except OSError as error:
            raise InputError(f"{path}: cannot write the fits there: {error.strerror or error}") from error

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "RestartFits":
        """Reads what `save` wrote.

        Args:
            path: the file.

        Raises:
            InputError: the file is missing, damaged, or not of the fits of restarts.
        """
        file, remedy = require_file(path), "remove it, and run the detection again"
        arrays = load_archive(file, remedy)
        try:
            method = _text(arrays.pop("method", None))
            if not arrays:
                raise ValueError("has no arrays")
            return cls(method, arrays)
        except ValueError as error:
            raise InputError(f"{file}: holds no fits of restarts ({one_line(error)}); {remedy}") from error


def mixture_arrays(mixture: GaussianMixture) -> dict[str, np.ndarray]:
    """The arrays of mixtures with a leading axis of restarts, by their names."""
    return {name: np.asarray(getattr(mixture, name)) for name in MIXTURE}


def status_array(result: FitStatus) -> np.ndarray:
    """How fits ended, as whole numbers."""
    (numbers,) = jax.tree.leaves(result)
    return np.asarray(numbers)


def of_restarts(make: Callable[[Mapping[str, np.ndarray]], Tree], arrays: Mapping[str, np.ndarray]) -> Tree:
    """The records of all restarts as one, with a leading axis of restarts.

    Args:
        make: the record of a restart from its part of the arrays.
        arrays: of at least one restart.
    """
    restarts = len(next(iter(arrays.values())))
    parts = ({name: np.asarray(values[restart]) for name, values in arrays.items()} for restart in range(restarts))
    records: Tree = stacked([make(part) for part in parts])
    return records


def mixture_of(arrays: Mapping[str, np.ndarray]) -> GaussianMixture:
    """The mixture of a restart from its part of the arrays."""
    return GaussianMixture(**{name: arrays[name] for name in MIXTURE})


def status_of(number: np.ndarray) -> FitStatus:
    """How a fit ended, or several, from the whole number."""
    result: FitStatus = jax.tree.unflatten(jax.tree.structure(FitStatus.converged), [number])
    return result


def _sizes(shape: str, slots: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(size for axis in shape for size in (slots if axis == "k" else (int(axis),)))


def _check_array(name: str, values: np.ndarray, kind: str, shape: tuple[int, ...]) -> None:
    if values.dtype.kind != kind or values.shape != shape or not shape[0]:
        wanted = {"f": "numbers", "i": "whole numbers", "b": "bools"}[kind]
        raise ValueError(f"{name} is {values.dtype} {list(values.shape)}, not {wanted} {list(shape)}")


def _check_finite(arrays: Mapping[str, np.ndarray], time: str) -> None:
    """A fit that says that it has a mixture has finite numbers, and a status that is known."""
    result = arrays[f"result{time}"]
    if result.min() < 0 or result.max() >= len(FitStatus):  # type: ignore[arg-type]
        raise ValueError(f"result{time} is no status of a fit")
    fitted = ~np.asarray(failed(status_of(result)))
    for name, values in arrays.items():
        if values.dtype.kind == "f" and not np.isfinite(values[fitted]).all():
            raise ValueError(f"{name} has numbers that are not finite")


def _text(value: Any) -> str:
    if not isinstance(value, np.ndarray) or value.dtype.kind != "U" or value.shape != ():
        raise ValueError(f"its method is {shown(value)}")
    return str(value)
