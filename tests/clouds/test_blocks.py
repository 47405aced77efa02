"""The blocks that two clouds are compared in, and the points of each."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax._cores import available_cores
from gmmjax.clouds import BlockSettings, Bounds, Lattice, PlacedClouds, tree_of
from gmmjax.errors import InputError
from gmmjax.geometry import rotation_about, transformed
from gmmjax.pair import Pair, each
from tests.clouds.made_clouds import ArrayCloud, ChunkedArray, MemoryBlockStore, slope

# Blocks of few points, so that small clouds have many.
SMALL = BlockSettings(voxels=8, covered=0.05, least_points=8, cells=4, cell_points=1.0)


def store_of(clouds, settings=SMALL, transform=None):
    placed = PlacedClouds(clouds.map(ArrayCloud), transform)
    return MemoryBlockStore(placed, tree_of(placed, settings))


@st.composite
def clouds(draw):
    """Clumps and planes of both clouds, far from the origin or near it, with points that are there twice."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    place = draw(st.sampled_from([0.0, 5e6, -3e5]))

    def cloud():
        parts = [
            random.normal(size=(draw(st.integers(1, 300)), 3)) * random.uniform(0.01, 3, 3) + random.uniform(-9, 9, 3)
            for _ in range(draw(st.integers(1, 4)))
        ]
        points = np.concatenate(parts) + place
        return np.concatenate([points, points[: draw(st.integers(0, 5))]])

    return Pair(cloud(), cloud())


@pytest.mark.slow
@settings(max_examples=12)
@given(clouds(), st.floats(0, 2), st.sampled_from([20.0, 200.0, np.inf]))
def test_every_row_is_in_one_block_and_the_margin_is_what_is_near(pair, margin, most):
    store = store_of(pair, dataclasses.replace(SMALL, most_points=most))
    relative = pair.map(lambda own: own - store.offset)
    seen = pair.map(lambda own: np.zeros(len(own), int))
    for block in store.blocks:
        found = store.points_of(block, margin)
        lower, upper = block.lower - margin, block.lower + block.edge + margin
        for own, points, rows, count in zip(found, relative, seen, block.counts, strict=True):
            assert own.inside.sum() == count
            rows[own.rows[own.inside]] += 1
            np.testing.assert_array_equal(own.points, points[own.rows])
            near = ((points >= lower) & (points <= upper)).all(axis=1)
            # Those inside may be beyond by a rounding error.
            assert set(own.rows) == set(np.flatnonzero(near)) | set(own.rows[own.inside])
            assert len(set(own.rows)) == len(own.rows)
            assert (np.diff(own.rows[own.inside]) > 0).all()
    assert all((own == 1).all() for own in seen)
    assert sum(block.counts.before + block.counts.after for block in store.blocks) == sum(map(len, pair))


@pytest.mark.slow
@settings(max_examples=12)
@given(clouds(), st.floats(0.5, 4), st.integers(1, 200))
def test_a_margin_of_too_many_points_is_thinned_and_the_block_is_not(pair, margin, most):
    store = store_of(pair, dataclasses.replace(SMALL, most_points=50.0))
    for block in store.blocks:
        everything, thinned = store.points_of(block, margin), store.points_of(block, margin, most)
        for whole, own in zip(everything, thinned, strict=True):
            np.testing.assert_array_equal(own.rows[own.inside], whole.rows[whole.inside])
            around, kept = whole.rows[~whole.inside], own.rows[~own.inside]
            assert set(kept) <= set(around) and len(kept) == len(set(kept)) <= most
            np.testing.assert_array_equal(own.points[~own.inside], whole.points[~whole.inside][np.isin(around, kept)])
            if len(around) <= most:
                np.testing.assert_array_equal(kept, around)


@settings(max_examples=8)
@given(clouds(), st.integers(40, 400))
def test_blocks_do_not_depend_on_the_chunks_or_the_order_of_the_points(pair, size):
    own = tree_of(PlacedClouds(pair.map(ArrayCloud)), SMALL)
    chunked = PlacedClouds(pair.map(lambda points: ChunkedArray(points[::-1].copy(), size)))
    other = tree_of(chunked, SMALL)
    for name in ("levels", "codes", "voxel_sizes"):
        np.testing.assert_array_equal(getattr(own, name), getattr(other, name))
    assert all(each(np.array_equal, own.counts, other.counts))


def test_voxels_are_as_fine_as_the_sparser_cloud_supports_there():
    pair = Pair(slope(60_000, 0), slope(30_000, 1))
    store = store_of(pair, BlockSettings(voxels=16, cell_points=1.0))
    assert len(set(store.tree.voxel_sizes)) >= 3
    # Near the corner the points are dense.
    corner, far = (
        store.blocks[int(store.tree.blocks_of(np.array([place]) - store.offset)[0])]
        for place in ([0.1, 0.1, 0.05], pair.after[np.argmax(pair.after[:, :2].sum(axis=1))])
    )
    assert corner.voxel_size < far.voxel_size / 3
    for block in store.blocks:
        if min(block.counts) > 64 and block.edge == 16 * block.voxel_size:
            cells = np.floor((store.inside(block.number).after.points - block.lower) / block.voxel_size)
            per_voxel = block.counts.after / len(np.unique(cells, axis=0))
            assert per_voxel > 2
    assert store.tree.spacing.after > store.tree.spacing.before
    # The spacing is that of a plane, nearly: the median of the local ones.
    assert store.tree.spacing.before == pytest.approx(np.sqrt(120 / 60_000), rel=0.8)


def test_few_points_have_large_voxels():
    few = np.random.default_rng(0).uniform(size=(400, 3)) * [1, 1, 0]
    (only,) = store_of(Pair(few, few[:300]), BlockSettings()).blocks
    # Four points in a voxel, or more: as many as a power of two gives.
    assert 4 <= 300 * only.voxel_size**2 < 16
    dense = np.random.default_rng(0).uniform(size=(40_000, 3)) * [1, 1, 0]
    assert store_of(Pair(dense, dense), BlockSettings()).blocks[0].voxel_size == pytest.approx(1 / 64, rel=1e-3)


def test_a_block_with_many_points_is_divided_and_keeps_its_voxels():
    dense, sparse = slope(40_000, 0), slope(300, 1)
    whole = store_of(Pair(dense, sparse))
    divided = store_of(Pair(dense, sparse), dataclasses.replace(SMALL, most_points=2_000.0))
    assert max(own.counts.before + own.counts.after for own in divided.blocks) <= 2_000
    # The sparse cloud decides on the voxels.
    assert max(own.counts.before for own in whole.blocks) > 2_000
    assert min(divided.tree.voxel_sizes) == min(whole.tree.voxel_sizes) > 10 * whole.tree.spacing.before


def test_the_finest_voxel_is_kept():
    pair = Pair(slope(20_000, 0), slope(20_000, 1))
    finest = store_of(pair).tree.voxel_sizes.min()
    assert store_of(pair, dataclasses.replace(SMALL, finest_voxel=2.5 * finest)).tree.voxel_sizes.min() >= 2.5 * finest


def test_survey_coordinates_lose_nothing():
    here, there = np.zeros(3), np.array([5_432_100.0, 5_678_900.0, 400.0])
    # Steps of 2^-20, which float64 holds at both places.
    pair = Pair(slope(2_000, 0), slope(2_000, 1)).map(lambda own: np.round(own * 2**20) / 2**20)
    near, far = (store_of(pair.map(lambda own, place=place: own + place)) for place in (here, there))
    for own, other in zip(near.blocks, far.blocks, strict=True):
        assert own.key == other.key
        for points, moved in zip(near.points_of(own, 0.2), far.points_of(other, 0.2), strict=True):
            np.testing.assert_array_equal(points.rows, moved.rows)
            np.testing.assert_allclose(points.points, moved.points, atol=1e-8)


def test_the_after_cloud_is_transformed():
    pair = Pair(slope(500, 0, lower=(5e6, 4e6, 0)), slope(400, 1, lower=(5e6, 4e6, 0)))
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    transform = rotation_about(turn, pair.after[0], pair.after[0] + [1, 2, 3])
    store = store_of(pair, transform=transform)
    for chosen in store.blocks:
        own = store.points_of(chosen, 0.0).after
        np.testing.assert_allclose(own.points + store.offset, transformed(pair.after, transform)[own.rows], atol=5e-9)


def test_declared_bounds_that_are_wrong_are_measured():
    pair = Pair(slope(500, 0), slope(400, 1))
    right = tree_of(PlacedClouds(pair.map(ArrayCloud)), SMALL)
    for declared in (np.zeros((2, 3)), np.array([[2.0, 2.0, 2.0], [3.0, 3.0, 3.0]])):
        wrong = pair.map(lambda own, box=declared: ChunkedArray(own, 100, Bounds(*box)))
        found = tree_of(PlacedClouds(wrong), SMALL)
        np.testing.assert_array_equal(found.codes, right.codes)
    exact = pair.map(lambda own: ChunkedArray(own, 100, Bounds(own.min(axis=0), own.max(axis=0))))
    np.testing.assert_array_equal(tree_of(PlacedClouds(exact), SMALL).codes, right.codes)


def test_clouds_without_points_or_of_one_place_are_rejected():
    some, none = np.ones((3, 3)), np.empty((0, 3))
    with pytest.raises(InputError, match="after: has no points"):
        store_of(Pair(some, none))
    with pytest.raises(InputError, match="all points are at one place"):
        store_of(Pair(some, some))


def test_a_cloud_that_cannot_be_read_stops_the_other_one():
    read = []

    class Endless(ChunkedArray):
        def chunks(self, size=1_000_000):
            while True:
                read.append(size)
                yield from super().chunks(size)

    class Broken(ChunkedArray):
        def chunks(self, size=1_000_000):
            yield from super().chunks(size)
            raise InputError("scan.las: is cut off")

    for pair in (Pair(Endless, Broken), Pair(Broken, Endless)):
        clouds = pair.map(lambda kind: kind(slope(300, 0), 100))
        # On a single core one is read after the other, and an endless one has no end.
        if available_cores() > 1:
            with pytest.raises(InputError, match="cut off"):
                tree_of(PlacedClouds(clouds), SMALL)
            assert read


def test_reading_tells_how_far_it_is():
    told = []
    pair = Pair(slope(300, 0), slope(200, 1)).map(lambda own: ChunkedArray(own, 100))
    tree_of(PlacedClouds(pair, progress=lambda message, share: told.append(share)), SMALL)
    assert sorted(told)[-1] == 1.0
    assert len(told) == 5


def test_blocks_on_a_given_lattice():
    pair = Pair(slope(2_000, 0), slope(2_000, 1))
    placed = PlacedClouds(pair.map(ArrayCloud))
    tree = tree_of(placed, SMALL, Lattice(np.array([-1.0, -1.0, -1.0]), 16.0))
    assert (np.log2(tree.edges) % 1 == 0).all()
    assert (tree.lowers % tree.edges[:, None] == 0).all()
    with pytest.raises(InputError, match="outside of its cube"):
        tree_of(placed, SMALL, Lattice(np.zeros(3), 4.0))
