"""The derivatives of a comparison against differences, by every leaf of the prior, points, masses and strengths."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gmmjax import compare
from gmmjax.comparison import FIT_SETTINGS
from tests.comparison.clouds import pair
from tests.differences import along
from tests.mixtures.differentiation import informative_prior

KEY = jax.random.key(0)
CASES = [
    ("greedy", "exact", {"temperature": 0.3}),
    ("greedy", "sinkhorn", {"epsilon": 0.2}),
    ("transport", "exact", {"temperature": 0.3, "penalty": 0.5}),
    ("joint", "exact", {}),
    ("transport", "sinkhorn", {"temperature": 0.3, "penalty": 0.5, "epsilon": 0.3}),
    ("joint", "sinkhorn", {}),
]


def outputs(arguments, method, solver):
    """The distances, the density of both mixtures at some places, the Brier score, and the log likelihood a point."""
    before, after, mass_before, mass_after, prior, strengths, truth = arguments
    settings = dataclasses.replace(FIT_SETTINGS[method], polish=True)
    given = dict(method=method, solver=solver, settings=settings, max_components=10, prior=prior, **strengths)
    found = compare(before, after, key=KEY, mass_before=mass_before, mass_after=mass_after, **given)
    probability = jnp.concatenate([found.probability_before, found.probability_after])
    places = jnp.array([[0.1, 0.2, 0.1], [3.9, 0.1, 0.4]])
    density = found.mixture_before.log_density(places) + found.mixture_after.log_density(places)
    score = jnp.mean((probability - truth) ** 2)
    likelihood = found.log_likelihood / len(truth)
    return jnp.stack([found.emd, found.emd_unchanged, *density, 100 * score, likelihood]), found


def scene(method, strengths):
    # Fewer points, of which each moves the result; masses that are not equal, and no sums of them.
    before, after, gone, new = pair(4, (20, 24, 23, 18, 21, 25, 19))
    random = np.random.default_rng(0)
    masses = [random.uniform(3.5, 4.5, len(own)) for own in (before, after)]
    prior = informative_prior(3)
    if method != "joint":
        prior = dataclasses.replace(prior, noise_share=None, noise_strength=jnp.asarray(0.5))
    prior = dataclasses.replace(prior, mean=jnp.array([1.0, 2.0, 1.0]))
    arguments = before, after, *masses, prior, strengths, np.concatenate([gone, new]).astype(float)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), arguments)


@pytest.mark.parametrize(
    ("method", "solver", "strengths"),
    [pytest.param(*case, marks=[pytest.mark.slow] * (nth > 0)) for nth, case in enumerate(CASES)],
)
def test_every_argument_has_its_derivatives(float64, method, solver, strengths):
    arguments = scene(method, strengths)
    function = functools.partial(outputs, method=method, solver=solver)
    jacobian, found = jax.jit(jax.jacrev(function, has_aux=True))(arguments)
    assert found.at_rest and not found.failed
    rows = jax.vmap(lambda own: ravel_pytree(own)[0])(jacobian)
    flat, unravel = ravel_pytree(arguments)
    values = jax.jit(lambda flat: function(unravel(flat))[0])
    random = np.random.default_rng(1)
    largest = np.abs(values(flat))
    for name, chosen in parts(arguments).items():
        direction = jnp.where(
            chosen, jnp.asarray(random.standard_normal(len(flat))) * jnp.maximum(jnp.abs(flat), 0.1), 0
        )
        direction /= jnp.sqrt(chosen.sum())
        expected = along(values, flat, direction, 1e-3)
        apart = np.abs(rows @ direction - expected.slope)
        allowed = 2 * expected.error + 1e-6 * np.maximum(np.abs(expected.slope), 1e-2 * largest)
        assert np.all(apart <= allowed), (name, expected, rows @ direction)


def parts(arguments):
    """Which numbers of all are of the points, the masses, each leaf of the prior, and each strength."""
    blank = jax.tree.map(jnp.zeros_like, arguments)
    names = {
        "points": (0, 1),
        "masses": (2, 3),
        **{f"prior {nth}": (4, nth) for nth in range(len(jax.tree.leaves(arguments[4])))},
        **{f"strength {nth}": (5, nth) for nth in range(len(jax.tree.leaves(arguments[5])))},
    }
    chosen = {}
    for name, places in names.items():
        leaves = list(blank)
        if name in ("points", "masses"):
            for place in places:
                leaves[place] = jnp.ones_like(leaves[place])
        else:
            tree, structure = jax.tree.flatten(leaves[places[0]])
            tree[places[1]] = jnp.ones_like(tree[places[1]])
            leaves[places[0]] = jax.tree.unflatten(structure, tree)
        chosen[name] = ravel_pytree(tuple(leaves))[0] > 0
    return chosen
