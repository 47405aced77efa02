import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.geometry import Contact, UpwardSettings, is_geocentric, upward_direction, z_is_height


def standing(direction, seed=0, count=40):
    """What stands on a surface with this normal, whose noise tilts the local planes."""
    random = np.random.default_rng(seed)
    normals = np.array(direction) + 0.05 * random.standard_normal((count, 3))
    senses = random.choice([-1, 1], (count, 1))
    return Contact(senses * normals / np.linalg.norm(normals, axis=1, keepdims=True), 0.2 * np.array(direction))


def test_upwards_is_from_the_surface_to_what_stands_on_it():
    for rotation in Rotation.random(5, random_state=0):
        direction = rotation.as_matrix()[:, 2]
        up = upward_direction([standing(direction, seed) for seed in range(3)])
        assert up @ direction > 0.99


def test_one_thing_on_a_wall_does_not_turn_it():
    up = upward_direction([*(standing((0, 0, 1.0), seed) for seed in range(3)), standing((1.0, 0, 0), 9)])
    assert up[2] > 0.99


def test_there_is_none_where_things_do_not_agree_or_touch_nothing():
    nothing = Contact(np.zeros((0, 3)), np.zeros(3))
    assert upward_direction([]) is None
    assert upward_direction([nothing, nothing]) is None
    assert upward_direction([standing((1.0, 0, 0)), standing((0, 1.0, 0)), standing((0, 0, 1.0))]) is None
    assert upward_direction([standing((1.0, 0, 0)), standing((0, 1.0, 0))], UpwardSettings(agreement=0.5)) is not None


def terrain(motion=np.eye(3), shift=(0.0, 0.0, 0.0), size=40.0):
    """Ground with bushes, in any frame."""
    random = np.random.default_rng(1)
    ground = random.uniform([0, 0, 0], [size, size, 1], (3000, 3))
    ground[::10, 2] += random.gamma(1.0, 2.0, 300)
    return ground @ np.transpose(motion) + shift


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (-20.0, -20.0, 0.0), (0.0, 0.0, 2.0), (5e5, 5.2e6, 300.0)])
def test_z_is_the_height_of_surveyed_ground(shift):
    assert z_is_height(terrain(shift=shift))


@pytest.mark.parametrize("stray", [0, 1])
def test_z_may_be_the_depth_of_what_a_camera_at_the_origin_sees(stray):
    """A table that a camera looks down at, z forward or backward, and the same frame with a stray point behind it."""
    forward = terrain(np.diag([1, -1, -1.0]), (-2.0, 2.0, 6.0), size=4.0)
    forward[:stray] = [0.1, 0.2, -1.0]
    assert not z_is_height(forward) and not z_is_height(forward * [1, -1, -1])


def from_the_centre(latitude, at=(0.0, 0.0, 6.371e6)):
    """The terrain at a place on the Earth, in coordinates from its centre."""
    return terrain() @ Rotation.from_euler("y", 90 - latitude, degrees=True).as_matrix().T + Rotation.from_euler(
        "y", 90 - latitude, degrees=True
    ).apply(at)


@pytest.mark.parametrize("latitude", [-80, -35, 10, 80])
def test_z_is_no_height_where_the_origin_is_the_centre_of_the_earth(latitude):
    points = from_the_centre(latitude)
    assert is_geocentric(points) and not z_is_height(points)


def test_a_northing_may_be_as_large_as_the_radius_of_the_earth():
    points = terrain(shift=(5e5, 6.35e6, 120.0))
    assert not is_geocentric(points) and z_is_height(points)


def test_z_is_no_height_where_a_scan_is_flatter_along_another_axis():
    assert not z_is_height(terrain(Rotation.from_euler("x", -90, degrees=True).as_matrix(), (-20.0, 0.0, 20.0)))
