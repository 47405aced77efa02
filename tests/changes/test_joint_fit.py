import jax
import numpy as np
import pytest

from gmmjax.changes.joint_fit import fit_joint_restarts, mixtures_distance
from gmmjax.changes.joint_mixture_model import SourcedPoints, joint_prior
from gmmjax.mixtures import FitSettings, WeightedPoints
from gmmjax.transport import exact_transport

SETTINGS = FitSettings(patience=0.05)


def sourced(size, seed=0):
    """Two Gaussians in both clouds and one in the after cloud alone."""
    random = np.random.default_rng(seed)
    number = random.integers(0, 3, size)
    points = random.standard_normal((size, 3)) * 0.3 + np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0]])[number]
    after = np.where(number == 2, 1.0, random.integers(0, 2, size).astype(float))
    return SourcedPoints(WeightedPoints(points, np.ones(size)), after)


def fits(size, components, slots):
    return fit_joint_restarts(
        sourced(size), key=jax.random.key(0), max_components=components, slots=slots, prior=joint_prior(1e-3, 0.0),
        restarts=2, max_points=6000, settings=SETTINGS,
    )  # fmt: skip


def test_more_slots_change_nothing():
    few, many = fits(240, 6, 6), fits(240, 6, 12)
    np.testing.assert_allclose(many.message_length, few.message_length, rtol=1e-9)
    np.testing.assert_array_equal(many.joint.mixture.live.sum(axis=1), few.joint.mixture.live.sum(axis=1))
    assert not many.joint.mixture.live[:, 6:].any()
    assert mixtures_distance(many) == pytest.approx(mixtures_distance(few), rel=1e-9)


def test_clouds_of_other_sizes_and_components_share_a_program():
    fits(240, 6, 12)
    programs = len(jax.devices()[0].client.live_executables())
    for size, components in ((200, 10), (255, 12), (120, 3)):
        mixtures_distance(fits(size, components, 12))
    assert len(jax.devices()[0].client.live_executables()) == programs


def test_the_distance_is_the_mean_of_the_restarts():
    found = fits(240, 6, 12)
    expected = []
    for restart in range(2):
        joint = jax.tree.map(lambda leaf, index=restart: leaf[index], found.joint)
        weights = [joint.mixture.weights * share for share in (1 - joint.share_after, joint.share_after)]
        means = joint.mixture.means * found.frame.spread
        costs = np.linalg.norm(means[:, None] - means[None], axis=2)
        with jax.enable_x64(True):
            expected.append(float(exact_transport(*(own / own.sum() for own in weights), costs).cost))
    assert mixtures_distance(found) == pytest.approx(np.mean(expected), rel=1e-9)
