import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.geometry.planes import Plane, PlaneSettings, plane_surface, planes_of


def patch(generator, rotation, offset, size=(1.0, 1.0), count=300, noise=0.004):
    """Points of a rectangle with the normal `rotation @ z`."""
    points = generator.uniform(-0.5, 0.5, (count, 3)) * [*size, 0]
    points[:, 2] = offset + noise * generator.normal(size=count)
    return points @ rotation.T


def planes(points, flatness, min_width, min_share):
    settings = PlaneSettings(min_share=min_share)
    return planes_of(plane_surface(points, settings), flatness, min_width, settings=settings)


@given(st.integers(0, 2**32 - 1))
def test_planes_are_found_again(seed):
    generator = np.random.default_rng(seed)
    turned = Rotation.random(random_state=int(seed)).as_matrix()
    floor, side = turned, turned @ Rotation.from_euler("x", 90, degrees=True).as_matrix()
    points = np.concatenate([patch(generator, floor, -0.5), patch(generator, side, 0.4, count=200)])
    found = planes(points, 0.02, 0.05, 0.1)
    assert len(found) == 2
    for plane, rotation, offset in zip(found, (floor, side), (-0.5, 0.4), strict=True):
        sign = np.sign(plane.normal @ rotation[:, 2])
        assert sign * plane.normal @ rotation[:, 2] > 0.999
        assert sign * plane.offset == pytest.approx(offset, abs=0.01)


def test_no_plane_in_a_cloud_or_a_strip():
    generator = np.random.default_rng(0)
    assert planes(generator.uniform(-1, 1, (300, 3)), 0.02, 0.1, 0.3) == []
    strip = patch(generator, np.eye(3), 0.0, size=(1.0, 0.1))
    assert planes(strip, 0.02, 0.05, 0.1) == []
    assert len(planes(strip, 0.02, 0.02, 0.1)) == 1
    assert planes(strip[:5], 0.02, 0.0, 0.1) == []


def test_noise_of_the_neighbourhoods():
    generator = np.random.default_rng(0)
    for noise in (0.002, 0.01):
        points = patch(generator, np.eye(3), 0.3, count=2000, noise=noise)
        assert plane_surface(points).thickness == pytest.approx(noise, rel=0.25)


def test_distance_and_projections():
    plane = Plane(np.array([0, 0, 1.0]), 2.0)
    points = np.array([[1, 2, 5.0], [0, 0, 1.0]])
    np.testing.assert_allclose(plane.distance(points), [3, 1])
    np.testing.assert_allclose(plane.projections(points), [[1, 2, 0], [0, 0, 0]])


def test_near_is_measured_along_the_plane():
    plane = Plane(np.array([0, 0, 1.0]), 2.0)
    points, others = np.array([[0, 0, 9.0], [1, 0, 2.0]]), np.array([[0.1, 0, -5.0]])
    assert plane.near(points, others, 0.2).tolist() == [True, False]
    assert not plane.near(points, np.zeros((0, 3)), 0.2).any()
    assert plane.near(np.zeros((0, 3)), others, 0.2).shape == (0,)


@pytest.mark.parametrize(("count", "others"), [(40, 500), (500, 40), (40, 0), (0, 40)])
def test_near_is_that_of_all_pairs(count, others):
    generator = np.random.default_rng(0)
    plane = Plane(np.array([0.6, 0, 0.8]), 0.3)
    # A small part of a large surface, some of it beyond the edge.
    points = generator.uniform([0.7, -0.2, -0.2], [1.1, 0.2, 0.2], (count, 3))
    surface = generator.uniform(-1, 1, (others, 3))
    apart = np.linalg.norm(plane.projections(points)[:, None] - plane.projections(surface)[None], axis=2)
    near = plane.near(points, surface, 0.1)
    np.testing.assert_array_equal(near, (apart < 0.1).any(axis=1))
    assert bool(near.any()) == (min(count, others) > 0)


def test_planes_of_some_of_the_points_and_at_most_some_planes():
    generator = np.random.default_rng(1)
    points = np.concatenate([patch(generator, np.eye(3), height) for height in (0.0, 1.0, 2.0)])
    surface = plane_surface(points)
    assert len(planes_of(surface, 0.02)) == 3
    assert len(planes_of(surface, 0.02, settings=PlaneSettings(max_planes=2))) == 2
    (plane,) = planes_of(surface, 0.02, chosen=points[:, 2] > 1.5)
    assert abs(plane.offset) == pytest.approx(2.0, abs=0.01)
