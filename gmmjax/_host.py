"""Between the host and traced code: which of the two holds an array, and how results leave."""

import os
from typing import TypeVar

import jax
import numpy as np

from gmmjax._typing import Array

_Tree = TypeVar("_Tree")


def is_traced(*trees: object) -> bool:
    """Whether any leaf is being traced by a JAX transformation."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def is_numpy(*trees: object) -> bool:
    """Whether all array leaves are NumPy's: the records of host functions, which are computed with in float64."""
    return not any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(trees))


def to_numpy(tree: _Tree) -> _Tree:
    """The tree with NumPy leaves, floating point ones in float64."""

    def leaf_to_numpy(leaf: Array) -> np.ndarray:
        array = np.asarray(leaf)
        return array.astype(np.float64) if np.issubdtype(array.dtype, np.floating) else array

    return jax.tree.map(leaf_to_numpy, tree)


def available_cores() -> int:
    """The processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
