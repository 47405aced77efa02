import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.geometry.depth_image import DepthImage, DepthImageSettings, Frustum, frustums

HALF_ANGLES = np.radians([30.0, 20.0])
FORWARD = Frustum(np.eye(3), HALF_ANGLES)


def rays(directions):
    """Unit vectors in directions, which are angles to the right and downwards."""
    towards = np.column_stack([np.tan(directions), np.ones(len(directions))])
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def wall(depth, half, spacing):
    """A square wall across the z axis."""
    steps = np.arange(-half, half + spacing / 2, spacing)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps))
    return np.column_stack([x, y, np.full_like(x, depth)])


def image_of(points, spacing, frustum=FORWARD):
    return DepthImage.of(points, np.full(len(points), spacing), frustum)


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(0.01, 1e3))
def test_a_frustum_holds_what_is_within_its_angles(right, down, distance):
    direction = np.array([[right, down]])
    inside, angles, ranges = FORWARD.project(distance * rays(direction))
    if (np.abs(direction) < HALF_ANGLES - 1e-6).all():
        assert inside.tolist() == [0]
        np.testing.assert_allclose(angles, direction, atol=1e-9)
        np.testing.assert_allclose(ranges, distance)
    elif (np.abs(direction) > HALF_ANGLES + 1e-6).any():
        assert not len(inside)


def test_nothing_behind_a_frustum_is_in_it():
    assert not len(FORWARD.project(np.array([[0, 0, -1.0], [0, 0, 0.0]]))[0])


def test_a_narrow_view_is_one_image():
    (frustum,) = frustums((60.0, 40.0))
    np.testing.assert_array_equal(frustum.rotation, np.eye(3))
    np.testing.assert_allclose(frustum.half_angles, np.radians([30, 20]))


def test_the_faces_of_a_cube_see_every_point_once():
    cube = frustums((360.0, 179.0))
    points = np.random.default_rng(0).normal(size=(2000, 3))
    seen = np.concatenate([face.project(points, margin=0.0)[0] for face in cube])
    np.testing.assert_array_equal(np.sort(seen), np.arange(len(points)))
    for face in cube:
        np.testing.assert_allclose(face.rotation.T @ face.rotation, np.eye(3), atol=1e-12)
        assert np.linalg.det(face.rotation) == pytest.approx(1)


@pytest.mark.parametrize("spacing", [0.01, 0.03, 0.1])
def test_a_surface_leaves_no_hole_at_any_spacing(spacing):
    """Not even at the rim of the image, where the wall ends far outside of it."""
    generator = np.random.default_rng(1)
    directions = generator.uniform(-HALF_ANGLES, HALF_ANGLES, (3000, 2))
    _, own, around = image_of(wall(2.0, 1.7, spacing), spacing).nearest(directions)
    # A bin may be empty where the size of the bins changes; those around it are not.
    assert np.isfinite(own).mean() > 0.995 and np.isfinite(around).all() and (around <= own).all()
    depth = (own * rays(directions)[:, 2])[np.isfinite(own)]
    # Within a bin the wall is nearer than in this direction by its slope.
    assert (np.abs(depth - 2.0) < 2 * spacing).all()


def test_the_nearest_surface_is_kept():
    both = np.concatenate([wall(2.0, 1.5, 0.02), wall(1.0, 0.2, 0.02)])
    image = image_of(both, 0.02)
    before, beside = np.array([[0.0, 0.0], [0.1, -0.1]]), np.array([[0.4, 0.0], [-0.3, 0.3]])
    assert (image.nearest(before).range < 1.1).all() and (image.nearest(beside).range > 1.9).all()
    # Just beside the edge of the near wall, at 0.2 rad, the bins around are of it already.
    _, own, around = image.nearest(np.array([[0.225, 0.0]]))
    assert own[0] > 1.9 and around[0] < 1.1


def test_the_points_around_a_direction():
    image = image_of(np.concatenate([wall(2.0, 1.5, 0.02), wall(1.0, 0.2, 0.02)]), 0.02)
    directions = np.array([[0.0, 0.0], [0.225, 0.0], [0.4, 0.0]])
    around, found = image.around(directions), image.nearest(directions)
    assert around.shape == (3, len(image.levels), 9)
    near_wall = len(wall(2.0, 1.5, 0.02))
    assert (around >= near_wall).any(axis=1).sum(axis=1).tolist() == [9, 3, 0]
    # The middle one of the nine is the bin of the direction itself, and the nearest of all is what `nearest` says.
    np.testing.assert_array_equal(np.max(around[..., 4], axis=1, where=around[..., 4] >= 0, initial=-1), found.point)
    for points, least in zip(around, found.range_around, strict=True):
        assert np.append(image.ranges, np.inf)[np.searchsorted(image.members[:-1], points[points >= 0])].min() == least


def test_directions_without_a_point_are_empty():
    _, own, around = image_of(wall(2.0, 0.2, 0.02), 0.02).nearest(np.array([[0.4, 0.3], [0.0, 0.0]]))
    assert np.isinf([own[0], around[0]]).all() and np.isfinite([own[1], around[1]]).all()


def test_an_image_of_nothing_is_empty():
    _, own, around = image_of(np.zeros((0, 3)), 0.01).nearest(np.zeros((3, 2)))
    assert np.isinf(own).all() and np.isinf(around).all()


@given(st.integers(0, 100))
def test_neither_the_order_nor_the_unit_changes_an_image(seed):
    generator = np.random.default_rng(seed)
    points = generator.uniform([-1, -1, 0.5], [1, 1, 4], (200, 3))
    spacing = generator.uniform(0.01, 0.3, len(points))
    directions = generator.uniform(-HALF_ANGLES, HALF_ANGLES, (100, 2))
    order = generator.permutation(len(points))
    here = DepthImage.of(points, spacing, FORWARD).nearest(directions)
    again = DepthImage.of(points[order], spacing[order], FORWARD).nearest(directions)
    np.testing.assert_array_equal(np.append(order, -1)[again.point], here.point)
    np.testing.assert_array_equal(again[1:], here[1:])
    # A power of two, so that no rounding differs.
    larger = DepthImage.of(1024 * points, 1024 * spacing, FORWARD).nearest(directions)
    np.testing.assert_array_equal(larger.point, here.point)
    np.testing.assert_array_equal(larger[1:], 1024 * np.array(here[1:]))


def test_the_settings_bound_images_and_bins():
    assert len(frustums((60.0, 40.0), DepthImageSettings(widest=50.0))) == 6
    settings = DepthImageSettings(finest_bin=1.0, coarsest_bin=4.0, sizes_per_octave=1)
    degrees = [settings.bin_size(level) / np.radians(1) for level in range(3)]
    np.testing.assert_allclose(degrees, [1, 2, 4])
    angles = np.radians([0.1, 1.0, 1.5, 2.0, 3.0, 9.0])
    np.testing.assert_array_equal(settings.bin_levels(angles), [0, 0, 1, 1, 2, 2])


def test_bins_below_the_spacing_leave_holes():
    points, directions = wall(2.0, 1.7, 0.05), np.random.default_rng(1).uniform(-0.3, 0.3, (1000, 2))
    image = DepthImage.of(points, np.full(len(points), 0.05), FORWARD, DepthImageSettings(bin_per_spacing=0.5))
    assert np.isinf(image.nearest(directions).range).mean() > 0.3
