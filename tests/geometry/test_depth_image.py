import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.clouds import SensorViews
from gmmjax.geometry.depth_image import Camera, DepthImage, cameras

HALF_ANGLES = np.radians([30.0, 20.0])
FORWARD = Camera(np.eye(3), HALF_ANGLES)


def views(*field_of_view):
    return SensorViews(np.eye(4)[None], field_of_view, 10.0)


def rays(directions):
    """Unit vectors in directions, which are angles to the right and downwards."""
    towards = np.column_stack([np.tan(directions), np.ones(len(directions))])
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def wall(depth, half, spacing):
    """A square wall across the z axis."""
    steps = np.arange(-half, half + spacing / 2, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    return np.column_stack([x, y, np.full_like(x, depth)])


def image_of(points, spacing, camera=FORWARD):
    return DepthImage.of(points, np.full(len(points), spacing), camera)


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(0.01, 1e3))
def test_a_camera_sees_what_is_within_its_angles(right, down, distance):
    direction = np.array([[right, down]])
    inside, angles, ranges = FORWARD.seen(distance * rays(direction))
    if (np.abs(direction) < HALF_ANGLES - 1e-6).all():
        assert inside.tolist() == [0]
        np.testing.assert_allclose(angles, direction, atol=1e-9)
        np.testing.assert_allclose(ranges, distance)
    elif (np.abs(direction) > HALF_ANGLES + 1e-6).any():
        assert not len(inside)


def test_nothing_behind_a_camera_is_seen():
    assert not len(FORWARD.seen(np.array([[0, 0, -1.0], [0, 0, 0.0]]))[0])


def test_a_narrow_view_is_one_image():
    (camera,) = cameras(views(60.0, 40.0))
    np.testing.assert_array_equal(camera.rotation, np.eye(3))
    np.testing.assert_allclose(camera.half_angles, np.radians([30, 20]))


def test_the_faces_of_a_cube_see_every_point_once():
    cube = cameras(views(360.0, 179.0))
    points = np.random.default_rng(0).normal(size=(2000, 3))
    seen = np.concatenate([camera.seen(points, rim=0.0)[0] for camera in cube])
    np.testing.assert_array_equal(np.sort(seen), np.arange(len(points)))
    for camera in cube:
        np.testing.assert_allclose(camera.rotation.T @ camera.rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(camera.rotation) == pytest.approx(1)


@pytest.mark.parametrize("spacing", [0.01, 0.03, 0.1])
def test_a_surface_leaves_no_hole_at_any_spacing(spacing):
    """Not even at the rim of the image, where the wall ends far outside of it."""
    generator = np.random.default_rng(1)
    directions = generator.uniform(-HALF_ANGLES, HALF_ANGLES, (3000, 2))
    own, around = image_of(wall(2.0, 1.7, spacing), spacing).nearest(directions)
    # A bin may be empty where the size of the bins changes; those around it are not.
    assert np.isfinite(own).mean() > 0.995 and np.isfinite(around).all() and (around <= own).all()
    depth = (own * rays(directions)[:, 2])[np.isfinite(own)]
    # Within a bin the wall is nearer than in this direction by its slope.
    assert (np.abs(depth - 2.0) < 2 * spacing).all()


def test_the_nearest_surface_is_kept():
    both = np.concatenate([wall(2.0, 1.5, 0.02), wall(1.0, 0.2, 0.02)])
    image = image_of(both, 0.02)
    before, beside = np.array([[0.0, 0.0], [0.1, -0.1]]), np.array([[0.4, 0.0], [-0.3, 0.3]])
    assert (image.nearest(before)[0] < 1.1).all() and (image.nearest(beside)[0] > 1.9).all()
    # Just beside the edge of the near wall, at 0.2 rad, the bins around are of it already.
    own, around = image.nearest(np.array([[0.225, 0.0]]))
    assert own[0] > 1.9 and around[0] < 1.1


def test_directions_without_a_point_are_empty():
    own, around = image_of(wall(2.0, 0.2, 0.02), 0.02).nearest(np.array([[0.4, 0.3], [0.0, 0.0]]))
    assert np.isinf([own[0], around[0]]).all() and np.isfinite([own[1], around[1]]).all()


def test_an_image_of_nothing_is_empty():
    own, around = image_of(np.zeros((0, 3)), 0.01).nearest(np.zeros((3, 2)))
    assert np.isinf(own).all() and np.isinf(around).all()


@given(st.integers(0, 100))
def test_neither_the_order_nor_the_unit_changes_an_image(seed):
    generator = np.random.default_rng(seed)
    points = generator.uniform([-1, -1, 0.5], [1, 1, 4], (200, 3))
    spacing = generator.uniform(0.01, 0.3, len(points))
    directions = generator.uniform(-HALF_ANGLES, HALF_ANGLES, (100, 2))
    order = generator.permutation(len(points))
    here = DepthImage.of(points, spacing, FORWARD).nearest(directions)
    np.testing.assert_array_equal(DepthImage.of(points[order], spacing[order], FORWARD).nearest(directions), here)
    # A power of two, so that no rounding differs.
    larger = DepthImage.of(1024 * points, 1024 * spacing, FORWARD).nearest(directions)
    np.testing.assert_array_equal(larger, 1024 * np.array(here))
