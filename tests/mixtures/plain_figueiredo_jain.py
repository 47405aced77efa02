"""The algorithm of Figueiredo and Jain (PAMI 2002, figure 2) in plain NumPy: the oracle of the compiled one.

Written from the paper, one component at a time, with densities evaluated directly. Slow, and meant to be read.
"""

import numpy as np


def density(points, mean, covariance):
    """The Gaussian density (2.2)."""
    deviations = points - mean
    mahalanobis = np.einsum("ni,ij,nj->n", deviations, np.linalg.inv(covariance), deviations)
    return np.exp(-mahalanobis / 2) / np.sqrt(np.linalg.det(2 * np.pi * covariance))


def sweep(points, mass, weights, means, covariances, noise_floor):
    """One component-wise sweep; weight 0 is a dead component. Returns new arrays."""
    weights, means, covariances = weights.copy(), means.copy(), covariances.copy()
    count, dimension = means.shape
    parameters = dimension + dimension * (dimension + 1) / 2
    densities = np.array([density(points, means[m], covariances[m]) for m in range(count)])
    for m in range(count):
        if weights[m] == 0:
            continue
        responsibilities = mass * weights[m] * densities[m] / (weights @ densities)
        support = responsibilities.sum()
        mean = responsibilities @ points / support
        deviations = points - mean
        covariance = (responsibilities[:, None] * deviations).T @ deviations / support
        weight = max(support - parameters / 2, 0) / mass.sum()
        if np.count_nonzero(weights) == 1:
            weight = 1.0
        weights[m] = weight
        weights = weights / weights.sum()
        if weight > 0:
            means[m], covariances[m] = mean, covariance + noise_floor**2 * np.eye(dimension)
            densities[m] = density(points, means[m], covariances[m])
    return weights, means, covariances


def log_likelihood(points, mass, weights, means, covariances):
    """(2.11), over the live components."""
    live = weights > 0
    total = sum(
        w * density(points, m, c) for w, m, c in zip(weights[live], means[live], covariances[live], strict=True)
    )
    return mass @ np.log(total)


def message_length(points, mass, weights, means, covariances):
    """Equation (15) of the paper, without its constants."""
    dimension = points.shape[1]
    parameters = dimension + dimension * (dimension + 1) / 2
    live = weights[weights > 0]
    penalty = parameters / 2 * np.log(live).sum() + (parameters + 1) / 2 * len(live) * np.log(mass.sum())
    return penalty - log_likelihood(points, mass, weights, means, covariances)


def fit(points, mass, weights, means, covariances, noise_floor, tolerance=1e-5, max_steps=100):
    """From the given components down to one; the shortest message length wins."""
    best = np.inf, None
    while True:
        previous = -np.inf
        for _ in range(max_steps):
            current = log_likelihood(points, mass, weights, means, covariances)
            if abs(current - previous) < tolerance * mass.sum():
                break
            before = np.count_nonzero(weights)
            weights, means, covariances = sweep(points, mass, weights, means, covariances, noise_floor)
            previous = -np.inf if np.count_nonzero(weights) < before else current
        length = message_length(points, mass, weights, means, covariances)
        if length < best[0]:
            best = length, (weights, means, covariances)
        if np.count_nonzero(weights) == 1:
            return best
        weights = weights.copy()
        weights[np.where(weights > 0, weights, np.inf).argmin()] = 0
        weights /= weights.sum()
