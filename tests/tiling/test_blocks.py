"""The blocks that two clouds are compared in, and the points of each."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax._cores import available_cores
from gmmjax.errors import InputError
from gmmjax.geometry import rotation_about, transformed
from gmmjax.pair import Pair, each
from gmmjax.tiling import tree_of
from tests.clouds.made_clouds import ChunkedArray, slope
from tests.tiling.stores import placed, store_of


@st.composite
def clouds(draw):
    """Clumps and planes of both clouds, far from the origin or near it, with points that are there twice."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    place = draw(st.sampled_from([0.0, 5e6, -3e5]))
    parts = [
        random.normal(size=(draw(st.integers(1, 300)), 3)) * random.uniform(0.01, 3, 3) + random.uniform(-9, 9, 3)
        for _ in range(draw(st.integers(2, 6)))
    ]
    middle = len(parts) // 2
    pair = Pair(np.concatenate(parts[:middle]), np.concatenate(parts[middle:]))
    return pair.map(lambda own: np.concatenate([own, own[:3]]) + place)


@settings(max_examples=8)
@given(clouds(), st.floats(0, 2), st.sampled_from([50, 200, 1_000_000]))
def test_every_row_is_in_one_block_and_around_it_is_what_is_near(tmp_path_factory, pair, margin, most):
    store = store_of(pair, tmp_path_factory.mktemp("store"), most)
    relative = pair.map(lambda own: own - store.offset)
    seen = pair.map(lambda own: [])
    for block in store.tree.blocks:
        lower, upper = block.grown(margin)
        inside, around = store.inside(block.number), store.points_around(block, margin, 10_000)
        for own, found, points, rows in zip(inside, around, relative, seen, strict=True):
            np.testing.assert_array_equal(own.points, points[own.rows])
            assert (np.diff(own.rows) > 0).all()
            rows += own.rows.tolist()
            np.testing.assert_array_equal(found[: len(own.rows)], own.points)
            near = ((points >= lower) & (points <= upper)).all(axis=1)
            # Those inside may be beyond by a rounding error.
            near[own.rows] = True
            np.testing.assert_array_equal(np.sort(found, axis=0), np.sort(points[near], axis=0))
    assert all(sorted(rows) == list(range(len(own))) for rows, own in zip(seen, pair, strict=True))


@settings(max_examples=8)
@given(clouds(), st.floats(0.5, 4), st.integers(1, 200))
def test_a_margin_of_too_many_points_is_thinned_and_the_block_is_not(tmp_path_factory, pair, margin, most):
    store = store_of(pair, tmp_path_factory.mktemp("store"), 100)
    for block in store.tree.blocks[::4]:
        everything, thinned = store.points_around(block, margin, 10_000), store.points_around(block, margin, most)
        for inside, whole, own in zip(store.inside(block.number), everything, thinned, strict=True):
            count = len(inside.points)
            np.testing.assert_array_equal(own[:count], whole[:count])
            around, kept = (points[count:].tolist() for points in (whole, own))
            assert len(kept) <= most
            # Evenly chosen: every second, fourth, ... of them.
            steps = [2**power for power in range(12) if kept == around[:: 2**power]]
            assert steps and (len(around) > most or steps[0] == 1)


@settings(max_examples=6)
@given(clouds(), st.integers(40, 400))
def test_blocks_do_not_depend_on_the_chunks_or_the_order_of_the_points(pair, size):
    own = tree_of(placed(pair), 50, 8)
    other = tree_of(placed(pair.map(lambda points: points[::-1].copy()), size=size), 50, 8)
    np.testing.assert_array_equal(own.levels, other.levels)
    np.testing.assert_array_equal(own.codes, other.codes)
    assert all(each(np.array_equal, own.counts, other.counts))
    assert own.spacing == other.spacing


def test_a_block_with_many_points_is_divided_and_one_with_few_is_not():
    pair = Pair(slope(20_000, 0), slope(300, 1))
    tree = tree_of(placed(pair), 2_000, 8)
    counts = tree.counts.before + tree.counts.after
    assert counts.max() <= 2_000 and counts.sum() == 20_300
    # The points are dense near the corner.
    assert tree.levels.max() - tree.levels.min() >= 2
    cells = tree.lowers / tree.edges[:, None]
    np.testing.assert_allclose(cells, np.rint(cells), atol=1e-9)
    assert len(tree_of(placed(pair), 30_000, 8)) == 1


def test_the_spacing_is_nearly_that_of_a_plane():
    spacing = tree_of(placed(Pair(slope(20_000, 0), slope(5_000, 1))), 1_000, 6).spacing
    # The median of the local ones.
    assert spacing.before == pytest.approx(np.sqrt(120 / 20_000), rel=0.8)
    assert spacing.after == pytest.approx(2 * spacing.before, rel=0.5)


def test_survey_coordinates_lose_nothing(tmp_path):
    # Steps of 2^-20, which float64 holds at both places.
    pair = Pair(slope(2_000, 0), slope(2_000, 1)).map(lambda own: np.round(own * 2**20) / 2**20)
    stores = []
    for name, place in (("near", np.zeros(3)), ("far", np.array([5_432_100.0, 5_678_900.0, 400.0]))):
        (tmp_path / name).mkdir()
        stores.append(store_of(pair.map(lambda own, place=place: own + place), tmp_path / name, 200))
    near, far = stores
    for number in range(len(near.tree)):
        for own, moved in zip(near.inside(number), far.inside(number), strict=True):
            np.testing.assert_array_equal(own.rows, moved.rows)
            np.testing.assert_allclose(own.points, moved.points, atol=1e-8)


def test_the_after_cloud_is_transformed(tmp_path):
    pair = Pair(slope(500, 0, lower=(5e6, 4e6, 0)), slope(400, 1, lower=(5e6, 4e6, 0)))
    angle = 0.3
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    transform = rotation_about(turn, pair.after[0], pair.after[0] + [1, 2, 3])
    store, expected = store_of(pair, tmp_path, 200, transform), transformed(pair.after, transform)
    for number in range(len(store.tree)):
        own = store.inside(number).after
        np.testing.assert_allclose(own.points + store.offset, expected[own.rows], atol=5e-9)


def test_points_outside_of_the_lattice_are_of_a_file_that_changed():
    clouds = placed(Pair(slope(2_000, 0), slope(2_000, 1)))
    small = dataclasses.replace(clouds, lattice=dataclasses.replace(clouds.lattice, edge=4.0))
    with pytest.raises(InputError, match="changed while it was read"):
        tree_of(small, 1_000, 8)


class Endless(ChunkedArray):
    def chunks(self, size=1_000_000):
        # Far longer than the other cloud, and not for ever: where nobody stops it, the test fails.
        for _ in range(10_000):
            yield from super().chunks(size)
        raise AssertionError("the other cloud's error did not stop this one")


class Broken(ChunkedArray):
    def chunks(self, size=1_000_000):
        yield from super().chunks(size)
        raise InputError("scan.las: is cut off")


@pytest.mark.skipif(available_cores() < 2, reason="one is read after the other")
@pytest.mark.parametrize("kinds", [Pair(Endless, Broken), Pair(Broken, Endless)])
def test_a_cloud_that_cannot_be_read_stops_the_other_one(kinds):
    points = slope(300, 0)
    clouds = dataclasses.replace(placed(Pair(points, points)), clouds=kinds.map(lambda kind: kind(points, 100)))
    with pytest.raises(InputError, match="cut off"):
        tree_of(clouds, 100, 8)
