import numpy as np
import pytest

from gmmjax.plotting.cloud_image import (
    Page,
    cloud_picture,
    density_picture,
    is_layered,
    scan_colors,
)
from gmmjax.plotting.projection import Projection

NOTHING = np.empty((0, 3))


def page(points, direction="above", pixels=100):
    return Page.around(Projection.of(direction, points), points, NOTHING, pixels)


def room(seed=0):
    """The walls, the floor and the ceiling of a room of 4 by 3 by 2.5 m."""
    points = np.random.default_rng(seed).uniform([0, 0, 0], [4, 3, 2.5], (6000, 3))
    axis = np.arange(6000) % 3
    points[np.arange(6000), axis] = np.where(np.arange(6000) % 2, np.array([4, 3, 2.5])[axis], 0)
    return points


@pytest.mark.parametrize("signs", [(1, 1, 1), (1, -1, -1)])
def test_directions_of_a_depth_camera(signs):
    """Both conventions: y down and z forward, or y up and z backward; from above, forward is up on the page."""
    points = np.random.default_rng(0).uniform([-1, -1, 3], [1, 1, 5], (100, 3)) * np.array(signs)
    above, front = (Projection.of(direction, points) for direction in ("above", "front"))
    assert above.on_page(np.array([[0.3, 0.1, 4]]) * signs).tolist() == [[0.3, 4]]
    np.testing.assert_allclose(front.on_page(np.array([[0.3, 0.1, 4]]) * signs), [[0.3, -0.1]])
    for projection in (above, front):
        np.testing.assert_allclose(np.cross(projection.right, projection.up), projection.towards_eye)


def test_nearest_points_hide_those_behind():
    """From above, a red square lies over a blue one."""
    square = np.random.default_rng(0).uniform(size=(2000, 2))
    points = np.c_[np.tile(square, (2, 1)), np.repeat([0.0, 1.0], 2000)]
    colors = np.repeat(np.array([[0, 0, 255], [255, 0, 0]], np.uint8), 2000, axis=0)
    picture = cloud_picture(points, colors, page(points))
    inner = picture[10:-10, 10:-10]
    covered = inner[..., 3] == 255
    assert covered.mean() > 0.95 and (inner[covered, 2] == 0).mean() > 0.95


def test_a_closed_room_is_seen_through_from_above_and_a_floor_is_not():
    assert is_layered(room(), page(room()))
    floor = room()
    floor[:, 2] = np.random.default_rng(1).normal(scale=0.01, size=6000)
    assert not is_layered(floor, page(floor))
    picture = density_picture(room(), page(room())).astype(int)
    # Walls, of which many points are behind each other, are darker than floor and ceiling.
    assert picture[20:60, 2:4, 0].mean() < picture[30:50, 40:60, 0].mean() - 30


def test_strays_do_not_shrink_the_picture():
    points = np.concatenate([np.random.default_rng(0).uniform(size=(5000, 3)), [[1e4, 1e4, 0]]])
    assert (page(points).upper < 1.2).all()


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.arange(3.0)[:, None] * [1.0, 0, 0], np.full((2, 3), 5e6)])
def test_any_cloud_has_a_picture(points):
    for direction in ("oblique", "above", "side"):
        own = page(points, direction)
        picture = cloud_picture(points, scan_colors(points, None, own.projection.up), own)
        assert picture[..., 3].any() and picture.shape == (own.height, own.width, 4)
