import jax
import numpy as np
import pytest

from gmmjax.changes.align.component_displacement import consensus_displacement
from gmmjax.mixtures import GaussianMixture

SLOTS = 6


def mixture(live, displacement=(0.0, 0.0, 0.0), seed=0):
    """Gaussians of different shapes in the first so many slots."""
    random = np.random.default_rng(seed)
    factors = random.uniform(-1, 1, (SLOTS, 3, 3)) * random.uniform(0.1, 1, SLOTS)[:, None, None]
    alive = np.arange(SLOTS) < live
    return GaussianMixture(
        weights=np.where(alive, 1 / live, 0),
        means=np.where(alive[:, None], random.uniform(-5, 5, (SLOTS, 3)) + np.array(displacement), 0),
        covariances=np.where(alive[:, None, None], factors @ factors.swapaxes(1, 2) + 0.01 * np.eye(3), np.eye(3)),
        live=alive,
    )


def test_a_displacement_is_found_whatever_is_missing():
    for live in (6, 5, 4):
        found = consensus_displacement(mixture(6), mixture(live, (0.3, -0.2, 0.1)), 1000.0, 1000.0)
        np.testing.assert_allclose(found.displacement, [-0.3, 0.2, -0.1], atol=1e-9)


def test_any_numbers_of_components_share_a_program():
    consensus_displacement(mixture(6), mixture(6), 1000.0, 1000.0)
    programs = len(jax.devices()[0].client.live_executables())
    for before, after in ((6, 5), (3, 6), (2, 4)):
        consensus_displacement(mixture(before), mixture(after), 1000.0, 1000.0)
    assert len(jax.devices()[0].client.live_executables()) == programs


def spheres(means, deviations):
    means = np.array(means, float)
    covariances = np.array(deviations, float)[:, None, None] ** 2 * np.eye(3)
    return GaussianMixture(np.full(len(means), 1 / len(means)), means, covariances, np.ones(len(means), bool))


def test_consensus_is_that_of_the_greater_mass():
    before = spheres([[0, 0, 0], [3, 0, 0], [0, 3, 0], [5, 5, 5]], [0.2, 0.3, 0.25, 0.4])
    after = spheres([[0.1, 0, 0], [3.1, 0, 0], [0.1, 3, 0], [4, 5, 5]], [0.2, 0.3, 0.25, 0.4])
    found = consensus_displacement(before, after, 4000.0, 4000.0)
    np.testing.assert_allclose(found.displacement, [-0.1, 0, 0], atol=1e-9)
    assert found.share == pytest.approx(0.75)
    assert (found.standard_error > 0.001).all() and (found.standard_error < 0.02).all()


def test_no_component_of_the_same_shape_means_no_consensus():
    found = consensus_displacement(spheres([[0, 0, 0]], [0.1]), spheres([[0, 0, 0]], [0.5]), 100.0, 100.0)
    assert found.share == 0 and (found.displacement == 0).all() and np.isinf(found.standard_error).all()
