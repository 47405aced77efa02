"""Loops inside `jax.shard_map`: what they start from varies over the mesh as the data do."""

import functools
import operator
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

_Tree = TypeVar("_Tree")


def varying_as(start: _Tree, *data: Any, linear: bool = False) -> _Tree:
    """What a loop starts from, of the type that it has after a step on the data.

    A constant is the same on all devices of a mesh, what was computed from data in shards is not, and `jax.shard_map`
    wants one type of a loop's carry. The values stay: a choice that depends on the data is between two that are equal.
    Outside of `jax.shard_map` there is nothing to do, and nothing to compile.

    Args:
        start: the values.
        data: from which they vary over the mesh.
        linear: whether it is a linear function of the start, which then must not vary by itself.
    """
    if not jax.sharding.get_abstract_mesh().manual_axes:
        return start
    varying = jax.tree.leaves(data if linear else (start, data))
    leaves = [leaf for leaf in varying if eqx.is_inexact_array(leaf) and leaf.size]
    first = [jnp.isnan(leaf[(0,) * leaf.ndim]) for leaf in leaves]
    either = functools.reduce(operator.or_, first, jnp.asarray(False))
    return jax.tree.map(lambda leaf: jnp.where(either, leaf, leaf), start)
