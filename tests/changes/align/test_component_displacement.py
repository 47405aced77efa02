import jax
import numpy as np

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
