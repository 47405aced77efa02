import dataclasses

import numpy as np
import pytest

from gmmjax.scenes.ray_casting import UNLABELLED, Solid, cast

BOX = Solid(np.array([0.3, -0.2, 0.5]), np.array([0.4, 0.7, 0.3]), yaw=0.6, label=4)
DRUM = Solid(np.array([-0.5, 0.4, 0.1]), np.array([0.5, 0.5, 0.8]), round=True, label=7)
STEPS = np.linspace(0, 6, 3001)


def rays(count, seed=0):
    """From one place outside either solid, in all directions."""
    directions = np.random.default_rng(seed).standard_normal((count, 3))
    return np.array([1.5, 1.2, 1.3]), directions / np.linalg.norm(directions, axis=1, keepdims=True)


def towards(solid, count, seed=0):
    """Rays from random places outside the solid to random places in the ball around it."""
    random = np.random.default_rng(seed)
    radius = np.linalg.norm(solid.extent)
    outward = random.standard_normal((count, 3))
    origins = solid.centre + 2 * radius * outward / np.linalg.norm(outward, axis=1, keepdims=True)
    directions = solid.centre + random.uniform(-0.5, 0.5, (count, 3)) * radius - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("solid", [BOX, DRUM])
def test_a_ray_is_outside_before_the_hit_and_inside_after_it(solid):
    origins, directions = towards(solid, 200)
    hits = 0
    for origin, direction in zip(origins, directions, strict=True):
        hit = solid.ranges(origin, direction[None])[0]
        inside = STEPS[solid.contains(origin + STEPS[:, None] * direction)]
        if np.isfinite(hit):
            hits += 1
            surface = origin + (hit + np.array([[-1e-7], [1e-7]])) * direction
            # Rays that only graze an edge leave again within a step.
            assert not solid.contains(surface[:1])[0]
            assert solid.contains(surface)[1] or not len(inside)
        assert not len(inside) or 0 <= inside[0] - hit <= STEPS[1]
    assert 60 < hits < 200


@pytest.mark.parametrize("solid", [BOX, DRUM])
def test_rays_that_point_away_hit_nothing(solid):
    origins, directions = towards(solid, 50)
    for origin, direction in zip(origins, directions, strict=True):
        assert solid.ranges(origin, -direction[None])[0] == np.inf


def test_a_ray_along_an_axis_hits_the_face():
    solid = Solid(np.array([0.0, 0.0, 0.5]), np.array([1.0, 1.0, 1.0]))
    down = np.array([[0.0, 0.0, -1.0]])
    np.testing.assert_allclose(solid.ranges(np.array([0.2, 0.1, 3.0]), down), 2.0)
    assert solid.ranges(np.array([0.7, 0.1, 3.0]), down)[0] == np.inf


@pytest.mark.parametrize("height", [3.0, -2.0])
def test_a_ray_along_the_axis_of_a_cylinder_hits_its_lid(height):
    solid = Solid(np.array([0.0, 0.0, 0.5]), np.array([1.0, 1.0, 1.0]), round=True)
    along = np.array([[0.0, 0.0, -np.sign(height)]])
    np.testing.assert_allclose(solid.ranges(np.array([0.45, 0.0, height]), along), 2.0)
    assert solid.ranges(np.array([0.45, 0.45, height]), along)[0] == np.inf


def test_the_nearest_solid_is_hit():
    origin, directions = rays(4000)
    ranges, labels = cast([BOX, DRUM], origin, directions)
    of_box, of_drum = BOX.ranges(origin, directions), DRUM.ranges(origin, directions)
    np.testing.assert_array_equal(ranges, np.minimum(of_box, of_drum))
    np.testing.assert_array_equal(labels == 4, of_box < of_drum)
    np.testing.assert_array_equal(labels == 7, of_drum < of_box)
    np.testing.assert_array_equal(labels == UNLABELLED, np.isinf(ranges))
    assert (labels == 4).any() and (labels == 7).any()


def test_the_order_of_the_solids_does_not_matter():
    origin, directions = rays(500)
    for one, other in zip(cast([BOX, DRUM], origin, directions), cast([DRUM, BOX], origin, directions), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_turned_solid_is_where_its_pose_says():
    corner = BOX.pose() @ np.array([*(BOX.extent / 2), 1.0])
    assert BOX.contains(corner[None, :3], margin=1e-9)[0]
    assert not BOX.contains(corner[None, :3], margin=-1e-9)[0]
    upright = dataclasses.replace(BOX, yaw=0.0)
    assert not upright.contains(corner[None, :3], margin=1e-9)[0]


def test_yaw_turns_from_x_to_y():
    turned = dataclasses.replace(BOX, yaw=np.pi / 2)
    np.testing.assert_allclose(turned.rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
