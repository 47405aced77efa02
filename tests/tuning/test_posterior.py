import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import FitSettings, InputError
from gmmjax.mixtures import FitStatus
from gmmjax.tuning import brier_score, check_gradient, joint_posterior, joint_prior
from tests.differences import Differences, assert_derivatives
from tests.mixtures.examples import random_rotation
from tests.tuning.scenes import gaussian_pair

KEY = jax.random.key(0)
PRIOR = joint_prior(0.05, 0.1)


@pytest.fixture(scope="module")
def scene():
    return gaussian_pair(3)


def posterior(scene, prior=PRIOR, before=None, after=None, **more):
    clouds = (scene.before if before is None else before, scene.after if after is None else after)
    return joint_posterior(*clouds, prior=prior, key=KEY, volumetric=True, max_components=12, **more)


@pytest.fixture(scope="module")
def run():
    """The posterior of two clouds, one program for all."""
    return jax.jit(lambda before, after: posterior(None, before=before, after=after))


@pytest.fixture(scope="module")
def found(scene, run):
    with jax.enable_x64(True):
        return run(jnp.asarray(scene.before), jnp.asarray(scene.after))


def test_says_what_changed(scene, found):
    assert found.result == FitStatus.converged
    for probability, truth in ((found.before, scene.truth_before), (found.after, scene.truth_after)):
        assert np.mean((np.asarray(probability) - (truth >= 0)) ** 2) < 0.05


def test_a_rigid_motion_of_both_clouds_changes_nothing(scene, run, found):
    rotation, shift = random_rotation(3, seed=0), np.array([3.0, -2.0, 1.0])
    with jax.enable_x64(True):
        moved = run(*(jnp.asarray(cloud @ rotation.T + shift) for cloud in (scene.before, scene.after)))
    # The box of the noise component turns with the axes.
    np.testing.assert_allclose(moved.after, found.after, atol=1e-3)


@pytest.mark.slow
def test_the_brier_score_has_the_gradient_of_differences(scene):
    changed = [(truth >= 0).astype(float) for truth in (scene.truth_before, scene.truth_after)]

    def loss(noise_floor, tolerance):
        found = posterior(scene, joint_prior(noise_floor, tolerance))
        return brier_score(jnp.concatenate([found.before, found.after]), jnp.concatenate(changed))

    entries = check_gradient(loss, 0.1, 0.3).entries
    expected = Differences(
        *(np.array([getattr(entry, name) for entry in entries]) for name in ("difference", "resolution"))
    )
    assert_derivatives([entry.gradient for entry in entries], expected)


def test_without_polish_there_is_no_gradient(scene):
    def probability(tolerance):
        return posterior(scene, joint_prior(0.05, tolerance), settings=FitSettings()).before.sum()

    with jax.enable_x64(True), pytest.raises(InputError, match="polish=True"):
        jax.jit(jax.grad(probability))(0.1)
