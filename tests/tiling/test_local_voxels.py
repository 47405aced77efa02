"""Voxels of blocks, joined to larger ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.changes import NAMES, VoxelLattice
from gmmjax.pair import Pair
from gmmjax.tiling.local_voxels import LocalVoxels, Voxels, joined
from gmmjax.tiling.records import BlockRecords, write_record

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


def of_one_block(folder, pair):
    parts = zip(NAMES, pair, strict=True)
    values = {f"{name}_{side}": array for side, own in parts for name, array in own._asdict().items()}
    records = BlockRecords(folder)
    records.add(write_record(folder, 0, values))
    return LocalVoxels(records, VoxelLattice(np.zeros(3), 2 * SIZE, 1), SIZE, Pair(200, 200), SIZE)


def test_voxels_of_a_block_are_as_large_as_asked_for_and_no_smaller_than_of_all_blocks(tmp_path):
    pair = Pair(voxels(2), voxels(3))
    of_all = of_one_block(tmp_path, pair)
    for asked, least in ((0.0, SIZE), (1.9 * SIZE, SIZE), (2 * SIZE, 2 * SIZE), (5 * SIZE, 4 * SIZE)):
        for side, own in zip(NAMES, pair, strict=True):
            found = of_all.of_cloud(0, side, asked)
            assert found.sizes.min() == least
            np.testing.assert_allclose(found.mass.sum(), own.mass.sum())


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 100), st.sampled_from([0.0, 2 * SIZE, 4 * SIZE]), st.floats(0, 4), st.floats(0, 4))
def test_voxels_in_a_box_are_the_same_as_those_of_the_whole_block(tmp_path_factory, seed, asked, low, high):
    pair, folder = Pair(voxels(seed), voxels(seed + 1)), tmp_path_factory.mktemp("block")
    of_all = of_one_block(folder, pair)
    corner, edge = np.full(3, min(low, high)), np.full(3, max(low, high))
    for side in NAMES:
        whole, found = of_all.of_cloud(0, side, asked), of_all.of_cloud(0, side, asked, (corner, edge))
        inside = ((whole.points >= corner) & (whole.points <= edge)).all(axis=1)
        for own, few in zip(whole, found, strict=True):
            np.testing.assert_array_equal(own[inside], few)


@pytest.mark.parametrize(("most", "finest"), [(1000, SIZE), (150, 2 * SIZE)])
def test_the_finest_voxel_is_one_that_is_there(tmp_path, most, finest):
    # Half of what the lattice has at most; with fewer they are joined.
    lattice, values = VoxelLattice(np.zeros(3), 2 * SIZE, 2), {}
    for seed, side in enumerate(NAMES):
        own = voxels(seed)
        numbers = [len(joined(own, lattice.finest * 2.0**level)[0].mass) for level in range(lattice.halvings + 1)]
        values |= {f"{name}_{side}": array for name, array in own._asdict().items()}
        values[f"numbers_{side}"] = np.array(numbers)
    records = BlockRecords(tmp_path)
    records.add(write_record(tmp_path, 0, values))
    assert lattice.finest == SIZE / 2
    assert LocalVoxels.of(records, lattice, most).finest == finest
