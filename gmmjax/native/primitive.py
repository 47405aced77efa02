"""A kernel as an operation of JAX, in whose place is plain code where a program goes and the kernel cannot."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir, xla

from gmmjax._varying import varying_as


def kernel_call(
    target: str,
    plain: Callable[..., Sequence[jax.Array]],
    results: Sequence[jax.ShapeDtypeStruct],
    *arguments: jax.Array,
) -> tuple[jax.Array, ...]:
    """See `gmmjax.native.kernel_or`, of a kernel that is available."""
    shapes = tuple((result.shape, result.dtype) for result in results)
    return tuple(_kernel.bind(*arguments, target=target, plain=plain, shapes=shapes, stack=()))


def _result_types(*_: Any, shapes: Sequence[tuple[Any, Any]], stack: tuple[int, ...], **__: Any) -> list[Any]:
    return [jax.core.ShapedArray((*stack, *shape), dtype) for shape, dtype in shapes]


def _batched(
    arguments: Sequence[jax.Array], axes: Sequence[int | None], *, stack: tuple[int, ...], **settings: Any
) -> tuple[list[jax.Array], list[int]]:
    """One more leading axis."""
    pairs = list(zip(arguments, axes, strict=True))
    size = next(own.shape[axis] for own, axis in pairs if axis is not None)
    leading = (own[None] if axis is None else jnp.moveaxis(own, axis, 0) for own, axis in pairs)
    found = _kernel.bind(*leading, stack=(size, *stack), **settings)
    return found, [0] * len(found)


def _lowered(context: mlir.LoweringRuleContext, *arguments: Any, target: str, **settings: Any) -> Any:
    module = context.module_context
    if tuple(context.platforms or module.platforms) == ("cpu",) and not module.lowering_parameters.for_export:
        return jax.ffi.ffi_lowering(target)(context, *arguments)
    return mlir.lower_fun(_plain)(context, *arguments, **settings)


def _plain(
    *arguments: jax.Array, plain: Callable[..., Any], stack: tuple[int, ...], shapes: Sequence[Any]
) -> Sequence[jax.Array]:
    """The plain function under as many `vmap`s as the stack has axes."""
    del shapes
    for axis in reversed(range(len(stack))):
        plain = jax.vmap(plain, [None if own.shape[axis] == 1 < stack[axis] else 0 for own in arguments])
    found: Sequence[jax.Array] = plain(*(_without_shared_axes(own, stack) for own in arguments))
    return found


def _without_shared_axes(argument: jax.Array, stack: tuple[int, ...]) -> jax.Array:
    return jnp.squeeze(argument, [axis for axis, size in enumerate(stack) if argument.shape[axis] == 1 < size])


def _differentiated(primals: Sequence[jax.Array], tangents: Sequence[Any], **settings: Any) -> Any:
    """By the plain function, whichever computes the values."""
    plain = functools.partial(_plain, **{name: settings[name] for name in ("plain", "stack", "shapes")})
    moved = tuple(map(ad.instantiate_zeros, tangents))
    return _kernel.bind(*primals, **settings), jax.jvp(plain, tuple(primals), moved)[1]


def _transposed(cotangents: Sequence[Any], *arguments: Any, stack: tuple[int, ...], **settings: Any) -> list[Any]:
    """By the kernel itself: only kernels that are linear in their last argument, and symmetric, are transposed."""
    *held, linear = arguments
    found = _kernel.bind(*held, ad.instantiate_zeros(cotangents[0]), stack=stack, **settings)[0]
    shared = [axis for axis, size in enumerate(stack) if linear.aval.shape[axis] < size]
    return [None] * len(held) + [varying_as(jnp.sum(found, shared, keepdims=True), held, cotangents[0], linear=True)]


_kernel = Primitive("gmmjax_kernel")
_kernel.multiple_results = True
_kernel.def_impl(functools.partial(xla.apply_primitive, _kernel))
_kernel.def_abstract_eval(_result_types)
ad.primitive_jvps[_kernel] = _differentiated
ad.primitive_transposes[_kernel] = _transposed
batching.primitive_batchers[_kernel] = _batched
mlir.register_lowering(_kernel, _lowered)
