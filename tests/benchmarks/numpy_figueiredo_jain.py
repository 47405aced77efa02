"""Figueiredo and Jain's algorithm (PAMI 2002, figure 2) in NumPy, as the thesis's code computes: the peer of our fit.

One component at a time, vectorised over the points; of the densities only those of the updated component are computed
anew. The oracle of the tests, `tests/mixtures/plain_figueiredo_jain.py`, is the same algorithm without this economy.
"""

import numpy as np

# Added to every mixture density, as in the authors' own program: a point may be too far from all of them.
SMALLEST = np.finfo(np.float64).tiny


def fit(points, max_components, noise_floor, seed=0, tolerance=1e-5, max_steps=100):
    """From k-means++ seeds down to one component.

    Returns:
        Message length, and weights, means and covariances of the live components of the best mixture.
    """
    means, covariances = start(points, max_components, noise_floor, seed)
    return annihilate(points, means, covariances, noise_floor, tolerance, max_steps)


def start(points, components, noise_floor, seed=0):
    """k-means++ seeds as means, the covariance of (2.17) for all."""
    variance = points.var(axis=0).mean() / 10 + noise_floor**2
    covariances = np.tile(variance * np.eye(points.shape[1]), (components, 1, 1))
    return seeds(points, components, np.random.default_rng(seed)), covariances


def annihilate(points, means, covariances, noise_floor, tolerance=1e-5, max_steps=100):
    """From components of equal weights down to one."""
    count, observations = len(means), len(points)
    weights = np.full(count, 1 / count)
    means, covariances = means.copy(), covariances.copy()
    densities = np.array([density(points, means[m], covariances[m]) for m in range(count)])
    best = np.inf, None
    while True:
        previous, current = -np.inf, log_likelihood(weights, densities)
        for _ in range(max_steps):
            before = np.count_nonzero(weights)
            sweep(points, weights, means, covariances, densities, noise_floor)
            previous = -np.inf if np.count_nonzero(weights) < before else current
            current = log_likelihood(weights, densities)
            if abs(current - previous) < tolerance * observations:
                break
        live = weights > 0
        length = message_length(weights[live], current, points.shape)
        if length < best[0]:
            best = length, (weights[live].copy(), means[live].copy(), covariances[live].copy())
        if live.sum() == 1:
            return best
        weights[np.where(live, weights, np.inf).argmin()] = 0
        weights /= weights.sum()


def sweep(points, weights, means, covariances, densities, noise_floor):
    """One component-wise sweep, in place; weight 0 is a dead component."""
    dimension = points.shape[1]
    parameters = dimension + dimension * (dimension + 1) / 2
    total = weights @ densities + SMALLEST
    for m in np.flatnonzero(weights):
        responsibilities = weights[m] * densities[m] / total
        support = responsibilities.sum()
        weight = max(support - parameters / 2, 0) / len(points) if np.count_nonzero(weights) > 1 else 1.0
        weights[m] = weight
        weights /= weights.sum()
        if weight > 0:
            means[m] = responsibilities @ points / support
            deviations = points - means[m]
            covariances[m] = (responsibilities[:, None] * deviations).T @ deviations / support
            covariances[m] += noise_floor**2 * np.eye(dimension)
            densities[m] = density(points, means[m], covariances[m])
        total = weights @ densities + SMALLEST


def density(points, mean, covariance):
    """The Gaussian density (2.2) at every point."""
    whitened = (points - mean) @ np.linalg.inv(np.linalg.cholesky(covariance)).T
    mahalanobis = np.einsum("ni,ni->n", whitened, whitened)
    return np.exp(-mahalanobis / 2) / np.sqrt(np.linalg.det(2 * np.pi * covariance))


def log_likelihood(weights, densities):
    """(2.11)."""
    return np.log(weights @ densities + SMALLEST).sum()


def message_length(weights, likelihood, shape):
    """Equation (15) of the paper without its constants, of the live components on [n, d] points."""
    observations, dimension = shape
    parameters = dimension + dimension * (dimension + 1) / 2
    size = (parameters + 1) / 2 * len(weights) * np.log(observations)
    return parameters / 2 * np.log(weights).sum() + size - likelihood


def seeds(points, count, random):
    """k-means++ (Arthur and Vassilvitskii 2007)."""
    chosen = [random.integers(len(points))]
    nearest = np.full(len(points), np.inf)
    for _ in range(count - 1):
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(random.choice(len(points), p=nearest / nearest.sum()))
    return points[chosen]
