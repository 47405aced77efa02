import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.geometry.planes import LocalPlanes, Plane, planes_of


def patch(generator, rotation, offset, size=(1.0, 1.0), count=300, noise=0.004):
    """Points of a rectangle with the normal `rotation @ z`."""
    points = generator.uniform(-0.5, 0.5, (count, 3)) * [*size, 0]
    points[:, 2] = offset + noise * generator.normal(size=count)
    return points @ rotation.T


@given(st.integers(0, 2**32 - 1))
def test_planes_are_found_again(seed):
    generator = np.random.default_rng(seed)
    turned = Rotation.random(random_state=int(seed)).as_matrix()
    floor, side = turned, turned @ Rotation.from_euler("x", 90, degrees=True).as_matrix()
    points = np.concatenate([patch(generator, floor, -0.5), patch(generator, side, 0.4, count=200)])
    found = planes_of(points, 0.02, 0.05, 0.1)
    assert len(found) == 2
    for plane, rotation, offset in zip(found, (floor, side), (-0.5, 0.4), strict=True):
        sign = np.sign(plane.normal @ rotation[:, 2])
        assert sign * plane.normal @ rotation[:, 2] > 0.999
        assert sign * plane.offset == pytest.approx(offset, abs=0.01)


def test_no_plane_in_a_cloud_or_a_strip():
    generator = np.random.default_rng(0)
    assert planes_of(generator.uniform(-1, 1, (300, 3)), 0.02, 0.1, 0.3) == []
    strip = patch(generator, np.eye(3), 0.0, size=(1.0, 0.1))
    assert planes_of(strip, 0.02, 0.05, 0.1) == []
    assert len(planes_of(strip, 0.02, 0.02, 0.1)) == 1
    assert planes_of(strip[:5], 0.02, 0.0, 0.1) == []


def test_noise_of_the_neighbourhoods():
    generator = np.random.default_rng(0)
    for noise in (0.002, 0.01):
        points = patch(generator, np.eye(3), 0.3, count=2000, noise=noise)
        assert LocalPlanes.of(points).noise == pytest.approx(noise, rel=0.25)


def test_distance_and_feet():
    plane = Plane(np.array([0, 0, 1.0]), 2.0)
    points = np.array([[1, 2, 5.0], [0, 0, 1.0]])
    np.testing.assert_allclose(plane.distance(points), [3, 1])
    np.testing.assert_allclose(plane.feet(points), [[1, 2, 0], [0, 0, 0]])
