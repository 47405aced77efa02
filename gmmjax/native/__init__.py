"""Compiled kernels for the CPU: the same answers as the plain code beside each call, in a fraction of the time.

They are built when the package is installed with a C++ compiler at hand. Without one, on other devices, and where the
environment variable `GMMJAX_NATIVE` is 0, everything runs in plain JAX, or NumPy and SciPy.
"""

import functools
import importlib
import os
import threading
from collections.abc import Callable, Sequence
from types import ModuleType

import jax

from gmmjax.native.primitive import kernel_call

# Turns the kernels off, where it is 0.
SWITCH = "GMMJAX_NATIVE"


_registering = threading.Lock()


def available() -> bool:
    """True if the kernels were built, fit this jaxlib, and are not switched off."""
    # Fits are traced by several threads at once, and handlers are registered once.
    with _registering:
        return _registered()


@functools.cache
def host_kernels() -> ModuleType | None:
    """The kernels for use on NumPy's arrays; None where they were not built, or are switched off."""
    if os.environ.get(SWITCH) == "0":
        return None
    try:
        kernels = importlib.import_module("gmmjax.native._kernels")
    except ImportError:
        return None
    # A checkout may hold a build of an earlier version.
    return kernels if "gmmjax_feature_sums_tangent" in kernels.targets() else None


@functools.cache
def _registered() -> bool:
    kernels = host_kernels()
    if kernels is None:
        return False
    try:
        for name, handler in kernels.targets().items():
            jax.ffi.register_ffi_target(name, handler, platform="cpu")
    except Exception:  # A jaxlib of another interface: what it raises is not documented.
        return False
    return True


def used() -> bool:
    """True if the kernels are used: they are available, and there is no device but the CPU."""
    return available() and jax.default_backend() == "cpu"


def kernel_or(
    target: str,
    plain: Callable[..., Sequence[jax.Array]],
    results: Sequence[jax.ShapeDtypeStruct],
    *arguments: jax.Array,
) -> tuple[jax.Array, ...]:
    """Compute by the kernel on a CPU, else in plain JAX.

    The choice is made when a program is lowered for its platform, so that nothing that was traced before can be wrong,
    and the plain code is traced only where it is used. What `jax.export` exports is plain: it may run in a process that
    knows no kernel.

    Args:
        target: the kernel's name for XLA.
        plain: a function of a module that computes the same.
        results: shapes and dtypes of what both return.
        arguments: of both; an axis that `vmap` adds is a leading one for the kernel, of size 1 where all share an
            argument.
    """
    return kernel_call(target, plain, results, *arguments) if available() else tuple(plain(*arguments))
