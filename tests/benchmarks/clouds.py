"""The data of the benchmarks: clouds of Gaussians, scans of a hall, batches of mixtures."""

import equinox as eqx
import jax
import numpy as np

from gmmjax import GaussianMixture
from gmmjax.mixtures import message_length
from gmmjax.scenes import random_scene

GAUSSIANS = 8
# Of the data's spread: what `fit_mixture` takes in float64. All fits are given the same.
RELATIVE_NOISE_FLOOR = 1e-3


def gaussian_cloud(size, seed=0, gaussians=GAUSSIANS):
    """About `size` points, as many of each of the Gaussians of a scene of thesis 4.6.1."""
    scene = random_scene(jax.random.key(seed), start=gaussians, appeared=0, overlap="medium", points=size // gaussians)
    return scene.before


def hall_pair(size, seed=0, size_after=None):
    """Two scans of `size` points of a hall of 30 m with two boxes of 1 m, of which one stands elsewhere later."""
    random = np.random.default_rng(seed)
    boxes = [[5, 5, 0], [20, 10, 0]], [[5, 5, 0], [12, 22, 0]]
    return tuple(_hall(random, *scan) for scan in zip((size, size_after or size), boxes, strict=True))


def changed_pair(size, seed=0, size_after=None):
    """Two clouds of about `size` points; one of five Gaussians goes and another comes."""
    density = (size_after or size) / size
    key = jax.random.key(seed)
    scene = random_scene(key, start=5, appeared=1, disappeared=1, points=size // 5, density=density)
    return scene.before, scene.after


def _hall(random, size, boxes):
    """A floor and two walls with 1 cm of noise, and three faces of each box."""
    floor, wall, face = size // 2, size // 4, size // 300
    along, up, noise = (lambda n: random.uniform(0, 30, n)), (lambda n: random.uniform(0, 6, n)), random.standard_normal
    parts = [
        np.column_stack([along(floor), along(floor), 0.01 * noise(floor)]),
        np.column_stack([along(wall), 0.01 * noise(wall), up(wall)]),
        np.column_stack([0.01 * noise(wall), along(wall), up(wall)]),
    ]
    for corner in boxes:
        for axis, side in ((2, 1.0), (1, 0.0), (0, 0.0)):
            points = random.uniform(0, 1, (face, 3))
            points[:, axis] = side
            parts.append(points + corner)
    return np.concatenate(parts)


def noise_floor(points):
    """In the unit of the points."""
    return RELATIVE_NOISE_FLOOR * float(np.sqrt(points.var(axis=0).mean()))


def mixtures(count, components, seed=0):
    """A stack of mixtures [count, components, ...]; of 16 slots or fewer more than half are live, of more all."""
    random = np.random.default_rng([seed, components])
    fewest = components if components > 16 else components // 2 + 1
    live = np.arange(components) < random.integers(fewest, components + 1, count)[:, None]
    weights = random.dirichlet(np.ones(components), count) * live
    weights /= weights.sum(axis=1, keepdims=True)
    means = random.uniform(-2, 2, (count, components, 3)) * live[..., None]
    covariances = np.tile(np.eye(3), (components, 1, 1))
    single = [GaussianMixture(w, m, covariances, alive) for w, m, alive in zip(weights, means, live, strict=True)]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *single)


def changed_mixtures(mixtures, seed=1):
    """The same mixtures a little displaced, with one Gaussian of each gone elsewhere."""
    random = np.random.default_rng(seed)
    means = mixtures.means + 0.02 * random.standard_normal(mixtures.means.shape)
    means[:, 0] = random.uniform(-2, 2, (len(means), 3))
    weights = mixtures.weights * random.uniform(0.9, 1.1, mixtures.weights.shape)
    weights /= weights.sum(axis=1, keepdims=True)
    changed = weights, means * mixtures.live[..., None]
    return eqx.tree_at(lambda mixture: (mixture.weights, mixture.means), mixtures, changed)


def exact_length(mixture, points):
    """The message length of a mixture on all points, recomputed in float64."""
    with jax.enable_x64(True):
        mixture = jax.tree.map(np.asarray, mixture)
        likelihood = float(mixture.log_density(points).sum())
        return float(message_length(mixture, likelihood, float(len(points))))


def as_mixture(weights, means, covariances):
    """A mixture of a peer, all of its components live."""
    arrays = (np.asarray(leaf, dtype=np.float64) for leaf in (weights, means, covariances))
    return GaussianMixture(*arrays, np.ones(len(weights), bool))
