import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

from gmmjax.geometry.density_clusters import density_clusters


def groups(count, seed=0):
    random = np.random.default_rng(seed)
    centres = random.uniform(0, 10, (count, 3))
    return np.concatenate([centre + 0.3 * random.standard_normal((80, 3)) for centre in centres])


def one_to_one(first, second):
    pairs = set(zip(first.tolist(), second.tolist(), strict=True))
    return len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


@given(st.integers(0, 30), st.floats(0.05, 1.5), st.integers(1, 12))
def test_equals_scikit_learn(seed, radius, neighbours):
    """The core points are grouped alike, the same points are noise, and others join a cluster that they touch."""
    points = groups(3, seed)
    labels = density_clusters(points, radius, neighbours)
    reference = DBSCAN(eps=radius, min_samples=neighbours).fit(points)
    core = reference.core_sample_indices_
    assert one_to_one(labels[core], reference.labels_[core])
    np.testing.assert_array_equal(labels < 0, reference.labels_ < 0)
    for index in np.setdiff1d(np.flatnonzero(labels >= 0), core):
        nearest = core[np.argmin(np.linalg.norm(points[core] - points[index], axis=1))]
        assert labels[index] == labels[nearest]


def test_clusters_do_not_depend_on_how_the_points_are_chunked():
    points = groups(5)
    whole = density_clusters(points, 0.4, 4)
    np.testing.assert_array_equal(density_clusters(points, 0.4, 4, chunk=7), whole)


def test_clusters_are_numbered_in_the_order_of_the_points():
    line = np.array([[9.0, 0], [9.1, 0], [0, 0], [0.1, 0], [5, 0]])
    np.testing.assert_array_equal(density_clusters(line, 0.2, 2), [0, 0, 1, 1, -1])


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.eye(3)])
def test_nothing_dense_is_no_cluster(points):
    assert (density_clusters(points, 0.1, 2) == -1).all()


def test_equal_points_are_one_cluster():
    assert (density_clusters(np.ones((50, 3)), 0.1, 50) == 0).all()


def test_a_radius_that_holds_all_points_needs_no_more_memory():
    """Every point is a neighbour of every other one: 900 million pairs."""
    points = np.random.default_rng(0).uniform(size=(30_000, 3))
    assert (density_clusters(points, 2.0, 8) == 0).all()


def test_surfaces_further_apart_than_the_radius_are_two_clusters():
    """Cells of either lie within reach of each other, and no two of their points do."""
    random = np.random.default_rng(0)
    flat = np.column_stack([random.uniform(size=(4000, 2)), np.zeros(4000)])
    for gap, clusters in ((0.0999, 1), (0.1001, 2)):
        both = np.concatenate([flat, flat + np.array([0, 0, gap])])
        assert density_clusters(both, 0.1, 8).max() + 1 == clusters


def test_one_radius_for_each_point_is_the_same_as_one_for_all():
    points = np.random.default_rng(21).uniform(0, 1, (2_000, 3))
    of_all = density_clusters(points, 0.06, 5)
    np.testing.assert_array_equal(density_clusters(points, np.full(2_000, 0.06), 5), of_all)
    assert of_all.max() > 1


def test_a_cluster_goes_on_where_its_points_get_sparser():
    """A strip whose second half has a tenth of the points; no single radius holds it together and its neighbour apart."""
    dense = np.column_stack([np.linspace(0, 1, 1_000), np.zeros(1_000)])
    sparse = np.column_stack([np.linspace(1.01, 2, 100), np.zeros(100)])
    beside = dense + [0.0, 0.01]
    points = np.concatenate([dense, sparse, beside])
    radius = np.concatenate([np.full(1_000, 0.005), np.full(100, 0.05), np.full(1_000, 0.005)])
    labels = density_clusters(points, radius, 4)
    assert set(labels[:1_100]) == {0}
    # The sparse half reaches the strip beside the dense one by its own radius: both are one with it.
    apart = density_clusters(np.concatenate([dense, beside]), 0.005, 4)
    assert set(apart) == {0, 1}
    joined = density_clusters(np.concatenate([dense, sparse]), 0.005, 4)
    assert (joined[1_000:] == -1).all()
