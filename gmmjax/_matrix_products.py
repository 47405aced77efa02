"""Matrix products of single precision, which accelerators compute in fewer digits unless told otherwise."""

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import jax

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def in_full_precision(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """The function, whose matrix products keep all digits of their factors on any device, in derivatives too.

    GPUs and TPUs round float32 factors to the 10 or 7 bits of TF32 or bfloat16 first, which is enough for neural
    networks. A log density is a difference of large squares: mixtures came out with twice the components. The setting
    is JAX's own, and holds while the function is traced.
    """

    @functools.wraps(function)
    def call(*arguments: _Parameters.args, **named: _Parameters.kwargs) -> _Result:
        with jax.default_matmul_precision("highest"):
            return function(*arguments, **named)

    return call
