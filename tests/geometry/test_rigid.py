import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.geometry.rigid import least_squares_transform, rigid_transform, rotated, rotation_about, transformed

SEEDS = st.integers(0, 2**32 - 1)


def random_motion(seed):
    """A rotation of SciPy, a translation, and points."""
    random = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=seed)
    return rotation, random.uniform(-5, 5, 3), random.normal(size=(20, 3))


def test_without_rotation_and_translation_it_is_the_identity():
    np.testing.assert_array_equal(rigid_transform(), np.eye(4))


@given(SEEDS)
def test_points_are_rotated_and_translated_as_by_scipy(seed):
    rotation, translation, points = random_motion(seed)
    transform = rigid_transform(rotation.as_matrix(), translation)
    np.testing.assert_allclose(transformed(points, transform), rotation.apply(points) + translation, atol=1e-12)
    np.testing.assert_allclose(rotated(points, transform), rotation.apply(points), atol=1e-12)
    np.testing.assert_array_equal(transform[3], [0, 0, 0, 1])


@given(SEEDS)
def test_transforms_compose_and_are_inverted_as_matrices(seed):
    rotation, translation, points = random_motion(seed)
    first, second = rigid_transform(rotation.as_matrix()), rigid_transform(rotation.as_matrix(), translation)
    both = transformed(transformed(points, first), second)
    np.testing.assert_allclose(transformed(points, second @ first), both, atol=1e-12)
    np.testing.assert_allclose(transformed(transformed(points, second), np.linalg.inv(second)), points, atol=1e-12)


@given(SEEDS)
def test_a_rotation_about_a_centre_brings_the_centre_to_its_destination(seed):
    rotation, destination, points = random_motion(seed)
    transform = rotation_about(rotation.as_matrix(), points[0], destination)
    np.testing.assert_allclose(transformed(points[:1], transform)[0], destination, atol=1e-12)
    expected = rotation.apply(points - points[0]) + destination
    np.testing.assert_allclose(transformed(points, transform), expected, atol=1e-12)


@given(SEEDS)
def test_least_squares_recovers_a_transform(seed):
    rotation, translation, points = random_motion(seed)
    transform = rigid_transform(rotation.as_matrix(), translation)
    found = least_squares_transform(points, transformed(points, transform))
    np.testing.assert_allclose(found, transform, atol=1e-9)


@given(SEEDS)
def test_least_squares_with_noise_is_that_of_scipy(seed):
    rotation, translation, points = random_motion(seed)
    target = rotation.apply(points) + translation + 0.1 * np.random.default_rng(seed + 1).normal(size=points.shape)
    expected, _ = Rotation.align_vectors(target - target.mean(axis=0), points - points.mean(axis=0))
    found = least_squares_transform(points, target)
    np.testing.assert_allclose(found[:3, :3], expected.as_matrix(), atol=1e-6)
    np.testing.assert_allclose(transformed(points.mean(axis=0)[None], found)[0], target.mean(axis=0), atol=1e-9)


def test_a_mirror_image_is_matched_by_a_rotation():
    points = np.random.default_rng(0).normal(size=(20, 3))
    found = least_squares_transform(points, points * [-1, 1, 1])
    assert np.isclose(np.linalg.det(found[:3, :3]), 1)
