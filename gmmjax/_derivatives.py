"""Derivatives that a result must not have: those of what failed, and those that would be wrong."""

from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Bool

from gmmjax._typing import Array
from gmmjax.errors import InputError

_Tree = TypeVar("_Tree")


@eqx.filter_custom_jvp
def nan_derivatives_unless(trusted: Bool[Array, ""], result: _Tree, arguments: Any) -> _Tree:
    """The result; where it is not trusted, its derivatives with respect to the arguments are NaN.

    That holds whatever lies between arguments and result, such as a choice between two values, which stops NaN. A lane
    of a batch that nothing is made of, such as a restart that failed and was left out, does no harm to others.
    """
    del trusted, arguments
    return result


@nan_derivatives_unless.def_jvp
def _nan_derivatives(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    trusted, result, arguments = primals
    moved = jax.tree.leaves(tangents[2])
    doubts = [jnp.sum(_doubted(trusted, tangent)) for tangent in moved]
    result = nan_derivatives_unless(trusted, result, arguments)

    def added(leaf: Any, tangent: Any) -> Any:
        if not eqx.is_inexact_array(leaf) or not moved:
            return tangent
        total = jnp.broadcast_to(sum(own.astype(leaf.dtype) for own in doubts), leaf.shape)
        # Either way, in the order of the mode, so that numbers that cancel out in the sum are seen, too.
        return _doubted(trusted, total) + (0 if tangent is None else tangent)

    return result, jax.tree.map(added, result, tangents[1], is_leaf=lambda leaf: leaf is None)


def _doubted(trusted: Bool[Array, ""], tangent: Array) -> Array:
    """0, or NaN where the tangent is not 0 and the result is not trusted; transposed, too."""

    def nan_or_zero(product: Any, tangent: Array) -> Array:
        del product
        return jnp.where(trusted | (tangent == 0), jnp.zeros_like(tangent), jnp.nan)

    # Inside `jax.shard_map` what solves takes tangents that vary over the mesh as the choice does.
    tangent = jnp.where(trusted, tangent, tangent)
    # Of JAX's linear operations the one whose value and transpose can be any.
    return jax.lax.custom_linear_solve(lambda own: own, tangent, nan_or_zero, transpose_solve=nan_or_zero)


@eqx.filter_custom_jvp
def without_derivatives(result: _Tree, arguments: Any, reason: str) -> _Tree:
    """The result, which was computed from arguments in a way that has no derivatives; to ask for them is an error."""
    del arguments, reason
    return result


@without_derivatives.def_jvp
def _no_derivatives(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    raise InputError(primals[2])
