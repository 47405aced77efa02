import dataclasses

import numpy as np
import pytest

from gmmjax.clouds import SensorViews
from gmmjax.scenes.depth_camera import DepthCamera
from gmmjax.scenes.ray_casting import UNLABELLED, Solid

CAMERA = DepthCamera(flying=0.0, lost=0.0)
HERE = np.eye(4)


def wall(distance, width=20.0, label=UNLABELLED, x=0.0):
    """Across the view of a camera at the origin that looks along z."""
    return Solid(np.array([x, 0.0, distance + 0.05]), np.array([width, 20.0, 0.1]), label=label)


def frame(solids, camera=CAMERA, pose=HERE, seed=0):
    return camera.frame(solids, pose, np.random.default_rng(seed))


def test_every_pixel_looks_into_the_field_of_view_and_the_outermost_reach_its_edge():
    directions = CAMERA.directions()
    views = SensorViews(HERE[None], CAMERA.field_of_view, CAMERA.max_range)
    assert len(directions) == 171 * 224
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    assert views.in_field_of_view(directions).all()
    assert not views.in_field_of_view(directions * np.array([1.02, 1.0, 1.0])).all()
    assert not views.in_field_of_view(directions * np.array([1.0, 1.02, 1.0])).all()


def test_without_noise_the_points_lie_on_what_the_camera_sees():
    points, labels = frame([wall(2.0, label=3)], dataclasses.replace(CAMERA, noise=0.0))
    np.testing.assert_allclose(points[:, 2], 2.0)
    assert len(points) == 171 * 224 and (labels == 3).all()


def test_a_pose_moves_the_points_with_the_camera():
    pose = np.array([[0.0, 0, 1, 0.5], [1, 0, 0, -0.2], [0, 1, 0, 0.1], [0, 0, 0, 1]])
    ahead = Solid(np.array([2.55, 0.0, 0.0]), np.array([0.1, 20.0, 20.0]))
    points, _ = frame([ahead], dataclasses.replace(CAMERA, noise=0.0), pose)
    np.testing.assert_allclose(points[:, 0], 2.5)
    assert len(points) == 171 * 224


@pytest.mark.parametrize(("distance", "factor"), [(1.0, 0.75), (2.0, 1.0), (3.0, 1.25)])
def test_the_noise_is_along_the_ray_and_grows_with_the_range(distance, factor):
    points, _ = frame([wall(distance)])
    ranges = np.linalg.norm(points, axis=1)
    directions = points / ranges[:, None]
    middle = directions[:, 2] > 0.99
    np.testing.assert_allclose(directions, CAMERA.directions(), atol=1e-12)
    along = ranges - distance / directions[:, 2]
    assert along[middle].std() == pytest.approx(factor * CAMERA.noise, rel=0.03)
    assert abs(along[middle].mean()) < 3e-4


@pytest.mark.parametrize("distance", [0.1, 6.0])
def test_nothing_too_near_or_too_far_is_returned(distance):
    assert len(frame([wall(distance)])[0]) == 0


def test_nothing_is_returned_where_there_is_nothing():
    assert len(frame([])[0]) == 0


def test_a_share_of_the_pixels_is_lost():
    points, _ = frame([wall(2.0)], dataclasses.replace(CAMERA, lost=0.1))
    assert len(points) / (171 * 224) == pytest.approx(0.9, abs=0.01)


def test_pixels_fly_only_at_edges_and_belong_to_no_change():
    """A board that stands before a wall: behind its edge a share of the pixels falls between the two."""
    solids = [wall(1.0, width=0.4, label=2), wall(2.0)]
    camera = dataclasses.replace(CAMERA, noise=0.0, flying=0.5)
    points, labels = frame(solids, camera)
    between = (points[:, 2] > 1.001) & (points[:, 2] < 1.999)
    assert (labels[between] == UNLABELLED).all()
    assert (labels[np.abs(points[:, 2] - 1) < 1e-9] == 2).all()
    # Two edges, each of one pixel in every row.
    assert between.sum() == pytest.approx(camera.rows, rel=0.25)
    on_edge = np.abs(np.abs(points[between, 0] / points[between, 2]) - 0.2)
    assert on_edge.max() < 2 * 2 * np.tan(np.radians(31)) / camera.columns
    still, _ = frame(solids, dataclasses.replace(camera, flying=0.0))
    assert not ((still[:, 2] > 1.001) & (still[:, 2] < 1.999)).any()


def test_a_frame_is_its_generator():
    once, again, other = (frame([wall(2.0)], seed=seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(once, again)
    assert (once != other).any()
