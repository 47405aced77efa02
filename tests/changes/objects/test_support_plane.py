import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.support_plane import support_planes
from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.geometry.rigid import transformed
from tests.changes.scanned_objects import on_floor_and_shelf

NOISE = 0.003


def planes_of(objects, background):
    return support_planes([LocalSurface.of(points) for points in objects], background, NOISE)


@pytest.fixture(scope="module")
def scene():
    return on_floor_and_shelf()


def test_the_support_plane_is_what_objects_stand_on(scene):
    objects, background = scene
    for plane, height in zip(planes_of(objects, background), (0.0, 0.6), strict=True):
        np.testing.assert_allclose(plane.up, [0, 0, 1], atol=0.03)
        assert plane.above(np.array([[0.0, 0.0, height], [1.0, 0.0, height]])).min() == pytest.approx(0, abs=0.04)


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_the_support_plane_is_transformed_with_the_scene(scene, seed):
    objects, background = scene
    transform = np.eye(4)
    transform[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    transform[:3, 3] = [3.0, -1.0, 2.0]
    turned = planes_of([transformed(points, transform) for points in objects], transformed(background, transform))
    for plane, other in zip(planes_of(objects, background), turned, strict=True):
        np.testing.assert_allclose(other.up, transform[:3, :3] @ plane.up, atol=1e-6)
        assert other.height == pytest.approx(plane.height + other.up @ transform[:3, 3], abs=1e-6)


def test_what_was_not_observed_is_no_support_plane(scene):
    objects, background = scene
    floor = background[background[:, 2] < 0.3]
    assert [plane is None for plane in planes_of(objects, floor)] == [False, True]
    assert planes_of(objects, np.zeros((0, 3))) == [None, None]


def test_things_at_walls_of_all_directions_have_no_support_plane(scene):
    """As in a module without gravity: each has the wall beside it, and no two of the walls are parallel."""
    objects, background = scene
    turns = [Rotation.from_euler("xyz", angles, degrees=True).as_matrix() for angles in np.eye(3) * 80]
    shifts = 5.0 * np.arange(3)[:, None]
    parts = [objects[0] @ turn.T + shift for turn, shift in zip(turns, shifts, strict=True)]
    near = background[background[:, 2] < 0.3]
    around = np.concatenate([near @ turn.T + shift for turn, shift in zip(turns, shifts, strict=True)])
    assert planes_of(parts, around) == [None] * 3
