"""Compiled programs of host functions: a long-lived process keeps the latest, not one for every shape it ever met."""

import functools
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, Generic, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

# Programs kept by one process: about as many as default detections of scans and volumes of 200 to 60,000 points need. A
# program holds about 5 MB. Without a bound, a process that meets ever new sizes or settings grows until it is killed.
MAX_PROGRAMS = 64

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")
_Value = TypeVar("_Value")


class LatestUsed(Generic[_Value]):
    """Values by key; beyond a number, those least recently used are dropped. For several threads."""

    def __init__(self, most: int):
        self._most = most
        self._values: OrderedDict[Hashable, _Value] = OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._values)

    def get(self, key: Hashable, make: Callable[[], _Value]) -> _Value:
        """The value of the key; made, and kept in place of the one not used for longest, where there is none."""
        with self._lock:
            value = self._values.pop(key, None)
            if value is None:
                value = make()
            self._values[key] = value
            while len(self._values) > self._most:
                self._values.popitem(last=False)
        return value


_programs: LatestUsed[Callable[..., Any]] = LatestUsed(MAX_PROGRAMS)


def lru_jit(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """`jax.jit`, but the process keeps only its `MAX_PROGRAMS` latest programs, of all functions together.

    JAX itself keeps every program until its function is gone. So each combination of shapes gets a function of its own,
    which is dropped with its program.

    Args:
        function: positional arguments are traced, keyword arguments are static and hashable.
    """

    @functools.wraps(function)
    def call(*arguments: _Parameters.args, **static: _Parameters.kwargs) -> _Result:
        leaves, structure = jax.tree.flatten(arguments)
        shapes = tuple((np.shape(leaf), getattr(leaf, "dtype", type(leaf))) for leaf in leaves)
        key = function, structure, shapes, tuple(sorted(static.items())), jnp.result_type(float)
        program = _programs.get(key, lambda: jax.jit(functools.partial(function, **static)))
        result: _Result = program(*arguments)
        return result

    return call
