"""Voxels of blocks, joined to larger ones."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.tiling.local_voxels import Voxels, joined

SIZE = 0.25


def voxels(seed, count=200):
    """The voxels of random points on the lattice, a part of them twice as large."""
    random = np.random.default_rng(seed)
    points, sizes = random.uniform(0, 4, (count, 3)), np.where(random.uniform(size=count) < 0.3, 2 * SIZE, SIZE)
    return Voxels(points, random.integers(1, 9, count).astype(float), sizes)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), doublings=st.integers(0, 3))
def test_joining_conserves_mass_and_means(seed, doublings):
    given_voxels, least = voxels(seed), SIZE * 2**doublings
    found, member = joined(given_voxels, least)
    assert (found.sizes >= least).all()
    np.testing.assert_allclose(np.bincount(member, given_voxels.mass), found.mass)
    for axis in range(3):
        moment = np.bincount(member, given_voxels.mass * given_voxels.points[:, axis])
        np.testing.assert_allclose(moment / found.mass, found.points[:, axis], atol=1e-12)


def test_what_is_large_enough_stays():
    given_voxels = voxels(0)
    found, member = joined(given_voxels, SIZE)
    np.testing.assert_array_equal(member, np.arange(len(member)))
    np.testing.assert_array_equal(found.points, given_voxels.points)


def test_joined_voxels_are_those_of_the_lattice():
    given_voxels = voxels(1)
    _, member = joined(given_voxels, 4 * SIZE)
    cells = (given_voxels.points // (4 * SIZE)).astype(int)
    same_voxel = member[:, None] == member
    same_cell = (cells[:, None] == cells).all(axis=2)
    np.testing.assert_array_equal(same_voxel, same_cell)
