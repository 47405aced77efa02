import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax.comparison.joint_mixture import (
    JointMixture,
    changed_share,
    density_ratio,
    intensities,
    responsibilities,
)
from gmmjax.comparison.joint_mixture_model import (
    JointMixtureModel,
    LabelledPoints,
    fit_joint_mixture,
    initial_joint_mixture,
    joint_prior,
)
from gmmjax.mixtures import FitSettings, GaussianMixture, WeightedPoints

PRIOR = joint_prior(1e-3, 0.0)
SETTINGS = FitSettings(patience=0.05)


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


def two_gaussians(seed, extra_after=0, points=300):
    """One Gaussian that both clouds have, and one more in the after cloud."""
    random = np.random.default_rng(seed)
    shared = random.standard_normal((2 * points, 3)) * 0.3 - 1
    extra = random.standard_normal((extra_after, 3)) * 0.3 + 1
    after = np.concatenate([np.zeros(points), np.ones(points + extra_after)])
    coordinates = np.concatenate([shared, extra])
    return LabelledPoints(WeightedPoints(coordinates, np.ones(len(coordinates))), after).padded()


@jax.jit
def fitted(points, prior=PRIOR):
    start = initial_joint_mixture(points, 8, prior, jax.random.key(0))
    return fit_joint_mixture(points, start, prior, SETTINGS)


@jax.jit
def sums_of(joint, points):
    return JointMixtureModel.of(points, PRIOR, SETTINGS).expectation(joint)


@pytest.mark.slow
def test_share_says_which_component_is_new():
    joint = fitted(two_gaussians(0, extra_after=300)).mixture
    live = np.asarray(joint.mixture.live)
    shares = np.sort(np.asarray(joint.share_after)[live])
    assert len(shares) == 2
    assert abs(shares[0] - 0.5) < 0.01 and shares[1] > 0.99
    new = changed_share(joint, density_ratio(joint), after=True)
    assert np.sort(np.asarray(new)[live]) == pytest.approx([0, 1], abs=0.02)
    assert np.allclose(changed_share(joint, density_ratio(joint), after=False), 0, atol=0.02)


def test_density_ratio_is_that_of_the_unchanged_part():
    random = np.random.default_rng(1)
    shared = random.standard_normal((900, 3)) * 0.3
    points = LabelledPoints(WeightedPoints(shared, np.ones(900)), (np.arange(900) < 300).astype(float)).padded()
    assert abs(float(density_ratio(fitted(points).mixture)) - 0.5) < 0.02


@pytest.mark.slow
def test_padding_changes_nothing():
    points = two_gaussians(2, extra_after=100, points=150)
    used = 400
    bare = LabelledPoints(WeightedPoints(points.points.points[:used], points.points.mass[:used]), points.after[:used])
    padded, exact = fitted(points), fitted(bare)
    assert float(padded.message_length) == pytest.approx(float(exact.message_length), abs=1e-6)
    np.testing.assert_allclose(padded.mixture.mixture.means, exact.mixture.mixture.means, atol=1e-8)


def test_swapping_the_clouds_swaps_the_shares():
    points = two_gaussians(3, extra_after=200)
    swapped = LabelledPoints(points.points, 1 - points.after)
    one, other = fitted(points).mixture, fitted(swapped).mixture
    np.testing.assert_allclose(one.share_after, 1 - other.share_after, atol=1e-9)
    assert float(density_ratio(one)) == pytest.approx(1 / float(density_ratio(other)))


@pytest.mark.slow
def test_message_length_never_rises_within_em():
    """One step of EM from a fixed number of components raises the likelihood, which the shares are part of."""
    points = two_gaussians(4, extra_after=200)
    model = JointMixtureModel.of(points, PRIOR, FitSettings(min_components=3))
    step = jax.jit(lambda joint, sums: model.annihilating_maximisation(joint, sums))
    joint = jax.jit(lambda points: initial_joint_mixture(points, 3, PRIOR, jax.random.key(1)))(points)
    likelihoods = []
    for _ in range(6):
        sums, likelihood = sums_of(joint, points)
        likelihoods.append(float(likelihood))
        joint = step(joint, sums)
    assert likelihoods[-1] > likelihoods[0]


@pytest.mark.slow
def test_expectation_against_plain_numpy():
    """Sums of responsibilities, sources and noise included, against SciPy's densities."""
    from scipy.stats import multivariate_normal

    points = two_gaussians(5, extra_after=50, points=60)
    joint = JointMixture(
        GaussianMixture(
            np.array([0.5, 0.4, 0.0]),
            np.array([[-1.0, -1, -1], [1, 1, 1], [0, 0, 0]]),
            np.stack([0.1 * np.eye(3), 0.2 * np.eye(3), np.eye(3)]),
            np.array([True, True, False]),
        ),
        np.array([0.5, 0.9, 0.5]),
        np.array(0.1),
        np.array(-3.0),
    )
    joint = jax.tree.map(jnp.asarray, joint)
    sums, likelihood = sums_of(joint, points)
    coordinates, after = points.points.points[:170], points.after[:170]
    densities = [
        weight * multivariate_normal(mean, covariance).pdf(coordinates) * np.where(after == 1, share, 1 - share)
        for weight, mean, covariance, share in (
            (0.5, [-1, -1, -1], 0.1 * np.eye(3), 0.5),
            (0.4, [1, 1, 1], 0.2 * np.eye(3), 0.9),
        )
    ]
    densities.append(np.full(170, 0.1 * np.exp(-3)))
    total = np.sum(densities, axis=0)
    assert float(likelihood) == pytest.approx(np.log(total).sum())
    expected = [(density / total).sum() for density in densities]
    np.testing.assert_allclose(np.asarray(sums)[[0, 1, 3], 0], expected)
    np.testing.assert_allclose(np.asarray(sums)[[0, 1], -1], [(d / total * after).sum() for d in densities[:2]])
    owned = np.asarray(responsibilities(joint, coordinates[60:], True))
    np.testing.assert_allclose(owned[0], (densities[0] / total)[60:], atol=1e-12)
    before, later = intensities(joint, coordinates)
    np.testing.assert_allclose(np.where(after == 1, later, before), total - 0.5 * 0 * total, rtol=1e-9)


def test_tolerance_widens_every_component():
    points = two_gaussians(6, extra_after=100)
    joint = fitted(points, joint_prior(0.0, 0.2)).mixture
    live = np.asarray(joint.mixture.live)
    assert (np.linalg.eigvalsh(np.asarray(joint.mixture.covariances)[live])[:, 0] > 0.2**2).all()
