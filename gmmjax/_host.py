"""Between the host and traced code: which of the two holds an array, and how results leave."""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import get_opaque_trace_state

from gmmjax._typing import Array
from gmmjax.errors import InputError

_Tree = TypeVar("_Tree")
_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

with jax.ensure_compile_time_eval():
    _OUTSIDE_OF_TRANSFORMATIONS = get_opaque_trace_state()


def is_traced(*trees: object) -> bool:
    """Whether any leaf is being traced by a JAX transformation, or whatever is computed is, as inside `jit`."""
    if _has_tracer(trees):
        return True
    # Inside `jit` every operation is traced, also on NumPy arrays. To try one takes longer than small problems do.
    return get_opaque_trace_state() != _OUTSIDE_OF_TRANSFORMATIONS and _has_tracer(jnp.zeros(()))


def _has_tracer(tree: object) -> bool:
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))


def check_static(**named: object) -> None:
    """Raises an `InputError` that names the argument, if one is traced that sizes arrays or chooses the program."""
    for name, value in named.items():
        if _has_tracer(value):
            raise InputError(
                f"{name} is traced, but the compiled program depends on its value: give it as a constant, in "
                f"jax.jit(..., static_argnames={name!r}) or from outside of the function; it cannot be mapped by vmap"
            )


def is_numpy(*trees: object) -> bool:
    """Whether all array leaves are NumPy's: the records of host functions, which are computed with in float64."""
    return not any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(trees))


def to_numpy(tree: _Tree) -> _Tree:
    """The tree with NumPy leaves, floating point ones in float64."""

    def leaf_to_numpy(leaf: Array) -> np.ndarray:
        array = np.asarray(leaf)
        return array.astype(np.float64) if np.issubdtype(array.dtype, np.floating) else array

    return jax.tree.map(leaf_to_numpy, tree)


def float64_on_host(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """The function, which for records of the host computes in float64, whatever JAX's setting, and returns NumPy.

    Where a record among its arguments has leaves that are JAX's, where anything is traced, and inside `jit`, it is the
    function as it stands: in the dtype of its arguments.

    Args:
        function: of one or more records, such as a method, and further arguments; or of arrays alone, which then count
            as records.
    """

    @functools.wraps(function)
    def call(*arguments: _Parameters.args, **settings: _Parameters.kwargs) -> _Result:
        given = *arguments, *settings.values()
        records = [own for own in given if isinstance(own, eqx.Module)] or given
        if not is_numpy(records) or is_traced(arguments, settings):
            return function(*arguments, **settings)
        with jax.enable_x64(True):
            return to_numpy(function(*_in_float64(arguments), **_in_float64(settings)))

    return call


def _in_float64(tree: Any) -> Any:
    """The tree with its floating point arrays as NumPy's, in float64."""

    def cast(leaf: Any) -> Any:
        floating = isinstance(leaf, jax.Array | np.ndarray) and jnp.issubdtype(leaf.dtype, np.floating)
        return np.asarray(leaf, np.float64) if floating else leaf

    return jax.tree.map(cast, tree)


def padded_chunks(rows: np.ndarray, size: int) -> list[np.ndarray]:
    """The rows in chunks of one size, the last one filled up with zeros: one compiled program for any number of rows.

    Args:
        rows: any number; of none there is a chunk of zeros.
        size: of a chunk.
    """
    chunks = max(1, -(-len(rows) // size))
    padding = ((0, chunks * size - len(rows)), *((0, 0) for _ in rows.shape[1:]))
    return np.split(np.pad(rows, padding), chunks)
