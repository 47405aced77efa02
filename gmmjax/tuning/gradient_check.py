"""Gradients against central differences: the test for every loss that goes through a fit."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gmmjax.errors import InputError

# Entries of a leaf that are compared, chosen at random where it has more.
MAX_ENTRIES = 6


@dataclasses.dataclass(frozen=True)
class EntryCheck:
    """One number that the function depends on.

    Attributes:
        name: the argument, its leaf and the entry.
        gradient: by JAX.
        difference: by central differences.
        resolution: what the differences are good for: how much they differ between two steps.
    """

    name: str
    gradient: float
    difference: float
    resolution: float

    @property
    def error(self) -> float:
        """Difference of the two, relative to the larger; NaN where one of them is."""
        largest = max(abs(self.gradient), abs(self.difference))
        return abs(self.gradient - self.difference) / largest if largest != 0 else 0.0


@dataclasses.dataclass(frozen=True)
class GradientCheck:
    """Result of `check_gradient`; printed, it is a table.

    Attributes:
        entries: the numbers that were compared.
    """

    entries: tuple[EntryCheck, ...]

    @property
    def largest_error(self) -> float:
        """The largest relative error; NaN where a derivative or the function is not a number."""
        return float(np.max([entry.error for entry in self.entries]))

    def __str__(self) -> str:
        width = max(len(entry.name) for entry in self.entries)
        lines = [f"{'':{width}}  {'gradient':>16}  {'difference':>16}  {'apart':>8}  {'resolved':>8}"]
        lines += [
            f"{entry.name:{width}}  {entry.gradient:16.9g}  {entry.difference:16.9g}  {entry.error:8.1e}  "
            f"{entry.resolution:8.1e}"
            for entry in self.entries
        ]
        return "\n".join(lines)


def check_gradient(
    function: Callable[..., Any], *arguments: Any, step: float = 1e-3, max_entries: int = MAX_ENTRIES, seed: int = 0
) -> GradientCheck:
    """Compares the gradient of a function with central differences of fourth order, in float64.

    Where a gradient goes through a fit, it holds while no component lives or dies; where it does within the step, the
    two differ. Try a smaller step before you doubt the gradient; `resolution` says what the differences are good for.

    Args:
        function: of the arguments, to a number; it is compiled.
        arguments: arrays, numbers or trees of them, such as a `Prior`; all are differentiated.
        step: of the differences, relative to the size of each number (absolute below 1).
        max_entries: entries of an array that are compared, chosen at random where it has more.
        seed: of that choice.

    Raises:
        InputError: the function gives no single finite number, or the arguments hold none to differentiate.
    """
    with jax.enable_x64(True):
        exact = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), arguments)
        if not jax.tree.leaves(exact):
            raise InputError("there is nothing to differentiate: give the arguments of the function")
        compiled = jax.jit(function)
        value = compiled(*exact)
        if jnp.shape(value) != () or not bool(jnp.isfinite(value)):
            raise InputError(f"the function must give one finite number, not {value}")
        gradients = jax.jit(jax.grad(function, argnums=tuple(range(len(exact)))))(*exact)
        leaves, structure = jax.tree.flatten(exact)
        names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(exact)]
        generator = np.random.default_rng(seed)
        entries = []
        for number, (name, leaf) in enumerate(zip(names, leaves, strict=True)):
            gradient = np.asarray(jax.tree.leaves(gradients)[number])

            def at(moved: np.ndarray, number: int = number) -> float:
                changed = [*leaves[:number], jnp.asarray(moved), *leaves[number + 1 :]]
                return float(compiled(*jax.tree.unflatten(structure, changed)))

            for index in _chosen(leaf.shape, max_entries, generator):
                difference, resolution = _difference(at, np.asarray(leaf), index, step)
                label = f"{name}{list(index)}" if index else name
                entries.append(EntryCheck(label, float(gradient[index]), difference, resolution))
        return GradientCheck(tuple(entries))


def _chosen(shape: tuple[int, ...], most: int, generator: np.random.Generator) -> list[tuple[int, ...]]:
    size = int(np.prod(shape))
    flat = np.arange(size) if size <= most else np.sort(generator.choice(size, most, replace=False))
    return [tuple(int(part) for part in np.unravel_index(number, shape)) for number in flat]


def _difference(
    function: Callable[[np.ndarray], float], leaf: np.ndarray, index: tuple[int, ...], step: float
) -> tuple[float, float]:
    """The derivative by the differences of fourth order, and how far those with twice the step are from it."""
    size = step * max(1.0, abs(float(leaf[index])))

    def at(steps: int) -> float:
        moved = leaf.copy()
        moved[index] += steps * size
        return function(moved)

    slopes = {steps: (at(steps) - at(-steps)) / (2 * steps * size) for steps in (1, 2, 4)}
    fine, coarse = ((4 * slopes[steps] - slopes[2 * steps]) / 3 for steps in (1, 2))
    return fine, abs(fine - coarse)
