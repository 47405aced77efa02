"""What a sparse block sees of dense ones beside it."""

import numpy as np
import pytest

from gmmjax.changes import (
    DifferenceSettings,
    LocalResolutionSettings,
    SignedDistanceSettings,
    VoxelLattice,
    overhead_viewpoint,
)
from gmmjax.pair import Pair
from gmmjax.tiling import local_differences
from gmmjax.tiling.local_differences import CoarseClouds, block_differences
from gmmjax.tiling.local_voxels import LocalVoxels, block_voxels
from gmmjax.tiling.records import BlockRecords, write_record
from tests.tiling.stores import store_of

SIZE = 0.4


def floor(seed):
    """A floor of 8 by 4 m, a hundred times as dense in one half as in the other."""
    random = np.random.default_rng(seed)
    parts = [random.uniform((lower, 0), (lower + 4, 4), (count, 2)) for lower, count in ((0, 20_000), (4, 200))]
    heights = random.normal(0, 0.002, (20_200, 1))
    return np.concatenate([np.concatenate(parts), heights], axis=1)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """The store of two such floors, their voxels, the coarse clouds, and the number of the sparse block."""
    store = store_of(Pair(floor(0), floor(1)), tmp_path_factory.mktemp("store"))
    lattice = VoxelLattice(np.zeros(3), SIZE, 3)
    folder = tmp_path_factory.mktemp("records")
    records = BlockRecords(folder)
    for block in store.tree.blocks:
        result = block_voxels(store, block, lattice, LocalResolutionSettings(voxels_per_edge=4))
        records.add(write_record(folder, block.number, result))
    points = Pair(floor(2)[::100], floor(3)[::100]).map(lambda own: own - store.offset)
    coarse = CoarseClouds(points, SIZE, points.map(overhead_viewpoint))
    counts = store.tree.counts.before + store.tree.counts.after
    sparse = max(store.tree.blocks, key=lambda own: own.grown(0.0)[1][0] if counts[own.number] > 100 else -np.inf)
    return store, LocalVoxels.of(records, lattice, 1_000_000), coarse, sparse, store.tree.blocks[int(np.argmax(counts))]


def differences(scene, block, *, fineness=np.inf, points=1_000_000):
    store, voxels, coarse, *_ = scene
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local_differences, "MARGIN_FINENESS", fineness)
        patch.setattr(local_differences, "MARGIN_POINTS", points)
        return block_differences(store, block, voxels, coarse, DifferenceSettings(), SignedDistanceSettings())


def test_bounds_hardly_change_what_a_sparse_block_says(scene):
    sparse = scene[3]
    everything, bounded = (differences(scene, sparse, fineness=own) for own in (np.inf, 4.0))
    assert np.abs(bounded["distance_before"] - everything["distance_before"]).max() < SIZE / 4
    few = differences(scene, sparse, points=2_000)
    # Within the noise of the points; at the rim a cylinder may be left with too few of them.
    for name in ("signed_before", "detection_before"):
        both = np.isfinite(few[name]) & np.isfinite(everything[name])
        assert both.sum() >= 0.9 * np.isfinite(everything[name]).sum()
        np.testing.assert_allclose(few[name][both], everything[name][both], atol=0.003)


def test_voxels_and_points_around_a_sparse_block_are_bounded(scene):
    sparse = scene[3]
    everything = differences(scene, sparse)
    joined, few = differences(scene, sparse, fineness=1.0), differences(scene, sparse, points=10)
    # The voxels of the other scan beside it are as large as its own, and the signed distance has fewer points.
    assert (joined["spacing_before"] > everything["spacing_before"] + 0.1).any()
    assert not np.array_equal(few["detection_before"], everything["detection_before"], equal_nan=True)


def test_a_dense_block_sees_the_same_whatever_the_fineness(scene):
    dense = scene[4]
    bounded = differences(scene, dense, fineness=4.0)
    for name, values in differences(scene, dense).items():
        np.testing.assert_array_equal(bounded[name], values, err_msg=name)
