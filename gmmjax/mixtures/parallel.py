"""Compiled functions on the host's cores."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import jax
import numpy as np

from gmmjax._cores import available_cores
from gmmjax._host import to_numpy

Precision = Literal["float64", "float32"]


def map_on_cores(
    function: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    precision: Precision,
    progress: Callable[[], None] | None = None,
) -> Any:
    """Runs a compiled function on the host for each tuple of arguments, shared out over the cores.

    Args:
        function: compiled by `jit`.
        arguments: one tuple of trees for each call, with NumPy leaves; all of the same shapes.
        precision: in which the floating point leaves go in.
        progress: called after each call, from any thread.

    Returns:
        The results stacked, as NumPy arrays.
    """

    def run(own: tuple[Any, ...]) -> Any:
        with jax.enable_x64(precision == "float64"):
            result = to_numpy(function(*in_precision(own, precision)))
        if progress is not None:
            progress()
        return result

    with ThreadPoolExecutor(min(len(arguments), available_cores())) as pool:
        results = list(pool.map(run, arguments))
    return stacked(results)


def stacked(trees: Sequence[Any]) -> Any:
    """One tree with a leading axis of trees, NumPy leaves."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *trees)


def in_precision(tree: Any, precision: Precision) -> Any:
    """The tree with its NumPy floating point leaves in this precision."""

    def cast(leaf: Any) -> Any:
        return leaf.astype(precision) if isinstance(leaf, np.ndarray) and leaf.dtype.kind == "f" else leaf

    return jax.tree.map(cast, tree)
