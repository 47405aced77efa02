import jax
import numpy as np

from gmmjax import GaussianMixture
from gmmjax.changes.objects.consensus import cloud_consensus, component_labels, votes_of_pairs

SIGNIFICANCE = np.array([[7.0, 8.0], [9.0, 6.0]])


def two_gaussians(gap=10.0):
    """Two restarts that found the same two Gaussians in another order, and 40 points of each."""
    means = np.array([[0, 0, 0], [gap, 0, 0]], float)
    one = GaussianMixture(np.full(2, 0.5), means, np.tile(np.eye(3), (2, 1, 1)), np.ones(2, bool))
    other = GaussianMixture(np.full(2, 0.5), means[::-1].copy(), np.tile(np.eye(3), (2, 1, 1)), np.ones(2, bool))
    points = np.random.default_rng(0).normal(size=(80, 3))
    points[40:] += means[1]
    return points, jax.tree.map(lambda *leaves: np.stack(leaves), one, other)


def test_votes_are_shares_over_the_solved_pairs():
    changed = np.zeros((4, 1, 2), bool)
    changed[:2, 0, 1] = True
    np.testing.assert_array_equal(votes_of_pairs(changed, np.ones((4, 1), bool)), [[0, 0.5]])
    valid = np.array([[True], [False], [False], [True]])
    np.testing.assert_array_equal(votes_of_pairs(changed, valid), [[0, 0.5]])
    np.testing.assert_array_equal(votes_of_pairs(changed, np.zeros((4, 1), bool)), [[0, 0]])


def test_probability_is_the_mean_vote_of_a_points_gaussians():
    points, mixtures = two_gaussians()
    votes = np.array([[0.0, 0.5], [1.0, 0.0]])
    consensus = cloud_consensus(points, mixtures, votes, SIGNIFICANCE, 0, "appeared", 0.5)
    np.testing.assert_allclose(consensus.probability, np.repeat([0.0, 0.75], 40))
    np.testing.assert_array_equal(consensus.labels, np.repeat([-1, 0], 40))
    (change,) = consensus.items
    assert change.kind == "appeared" and change.point_count == 40 and change.probability == 0.75
    assert change.significance == 8.0
    np.testing.assert_array_equal(change.mean, [10, 0, 0])
    assert (np.abs(change.box.centre - np.array([10, 0, 0])) < 1).all()


def test_below_the_threshold_nothing_changed():
    points, mixtures = two_gaussians()
    consensus = cloud_consensus(points, mixtures, np.array([[0.0, 0.4], [0.4, 0.0]]), SIGNIFICANCE, 0, "appeared", 0.5)
    assert not consensus.items and (consensus.labels == -1).all()
    assert consensus.probability.max() == 0.4


def test_survey_coordinates_are_labelled_alike():
    points, mixtures = two_gaussians()
    offset = np.array([1e6, -2e6, 3e6])
    moved = jax.vmap(lambda mixture: mixture.rescaled(1.0, offset))
    with jax.enable_x64(True):
        moved = jax.tree.map(np.asarray, moved(mixtures))
    there, here = component_labels(points + offset, moved), component_labels(points, mixtures)
    np.testing.assert_array_equal(there.together(), here.together())


def test_labels_do_not_depend_on_the_chunks(monkeypatch):
    points, mixtures = two_gaussians()
    labels = component_labels(points, mixtures).together()
    # 80 points in three chunks, the last of which is padded.
    monkeypatch.setattr("gmmjax.changes.objects.consensus.CHUNK", 32)
    np.testing.assert_array_equal(component_labels(points, mixtures).together(), labels)


def test_a_part_of_the_points_is_labelled_as_in_the_whole():
    points, mixtures = two_gaussians()
    labels, rows = component_labels(points, mixtures), np.arange(3, 70, 5)
    np.testing.assert_array_equal(labels.together(rows), labels.together()[rows])
    assert labels.together(rows[:0]).shape == (0, 2)
