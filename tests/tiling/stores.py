"""Stores of clouds in memory."""

import numpy as np

from gmmjax.geometry import transformed
from gmmjax.tiling import Lattice, PlacedClouds, tree_of, write_block_store
from tests.clouds.made_clouds import ChunkedArray


def placed(points, transform=None, size=1_000_000):
    """Two clouds in a cube around both."""
    after = points.after if transform is None else transformed(points.after, transform)
    both = np.concatenate([points.before, after])
    lower, extent = both.min(axis=0), np.ptp(both, axis=0).max()
    lattice = Lattice(lower - 1e-3 * extent, float(1.01 * extent))
    return PlacedClouds(points.map(lambda own: ChunkedArray(own, size)), lattice, transform)


def store_of(points, folder, max_points=20_000, transform=None):
    """The clouds on disk, in a new folder, in blocks of at most so many points."""
    clouds = placed(points, transform)
    return write_block_store(clouds, tree_of(clouds, max_points, 8), folder)
