"""Small pairs of clouds with one Gaussian gone and one new."""

import numpy as np

# Seen before and after, before alone, after alone.
KEPT = [[0, 0, 0], [4, 0, 0.5], [2, 2, 4], [-2, 3, 1], [1, -3, 2], [5, 3, 0]]
GONE, NEW = [0, 3, -3], [3, 5, 2]
SIZES = (80, 97, 91, 73, 86, 101, 75)


def pair(seed=0, sizes=SIZES, spread=0.25):
    """Two clouds and the truth of their points; no two sums of their Gaussians' sizes are equal."""
    random = np.random.default_rng(seed)
    clouds, truths = [], []
    for time, own in enumerate((GONE, NEW)):
        counts = [size + 3 * time + 2 * place for place, size in enumerate(sizes)]
        centres = [*KEPT, own]
        clouds.append(
            np.concatenate([random.normal(at, spread, (n, 3)) for at, n in zip(centres, counts, strict=True)])
        )
        truths.append(np.repeat([False] * len(KEPT) + [True], counts))
    return *clouds, *truths


def padded(cloud, rows):
    """The cloud filled up to some rows, and the masses that say so."""
    missing = rows - len(cloud)
    mass = np.pad(np.ones(len(cloud)), (0, missing))
    return np.concatenate([cloud, np.full((missing, cloud.shape[1]), 0.5)]), mass
