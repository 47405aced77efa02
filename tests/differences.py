"""Derivatives by differences that know how good they are: what the tests hold every gradient against."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

# Of a derivative in float64, relative to the largest: the linear systems of implicit derivatives are solved to 1e-9.
PRECISION = 1e-7
# Differences that are rougher than this, relative to the largest, can tell nothing of a gradient.
RESOLVED = 1e-4


class Differences(NamedTuple):
    """Derivatives by differences, and how far each may be off."""

    slope: np.ndarray
    error: np.ndarray


def along(function, at, direction, step):
    """The derivative of a function of a tree along a direction, by central differences of the fourth order.

    Those of twice the step are off by sixteen times as much, and both by what the function's values are rounded to:
    how far the two are apart, and the rounding, are the error.
    """

    def value(steps):
        moved = jax.tree.map(lambda leaf, way: leaf + steps * step * way, at, direction)
        return np.asarray(function(moved), np.float64)

    sides = {steps: (value(steps), value(-steps)) for steps in (1, 2, 4)}
    slopes = {steps: (up - down) / (2 * steps * step) for steps, (up, down) in sides.items()}
    fine, coarse = ((4 * slopes[steps] - slopes[2 * steps]) / 3 for steps in (1, 2))
    rounding = np.finfo(np.float64).eps * np.maximum(*map(np.abs, sides[1])) / step
    return Differences(fine, np.abs(fine - coarse) + 2 * rounding)


def difference_gradient(function, at, step=3e-3):
    """The gradient of a function of a vector by differences, with steps relative to its entries."""
    scales = np.maximum(np.abs(np.asarray(at)), 0.1)
    entries = [along(function, at, jnp.asarray(way), step) for way in np.diag(scales)]
    return Differences(*(np.array(parts) / scales for parts in zip(*entries, strict=True)))


def assert_derivatives(found, expected, precision=PRECISION):
    """Derivatives are as near to the differences as these can tell, and as the precision lets them be.

    Args:
        found: the derivatives, as many as there are differences.
        expected: the differences.
        precision: of the derivatives, relative to the largest: rounding in the large ones shows in the small ones.
    """
    found, largest = np.asarray(found, np.float64), np.abs(expected.slope).max()
    assert np.max(expected.error) <= RESOLVED * largest, f"the differences are too rough to judge by: {expected}"
    apart = np.abs(found - expected.slope)
    allowed = 2 * expected.error + precision * largest
    assert np.all(apart <= allowed), f"{found} differs from {expected.slope} by {apart}, where {allowed} is allowed"
