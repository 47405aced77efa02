import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.geometry import rigid_transform
from gmmjax.scenes import Bowl, Cup, Ellipsoid, Ground, Solid, Vegetation
from gmmjax.scenes.ray_casting import cast

EXTENT = np.array([0.6, 0.4, 0.5])
ORIGIN = np.zeros(3)
HILLS = np.sin(np.arange(30)[:, None] / 4) * np.cos(np.arange(30) / 5)


def rays_at(solid, origin, count=2000):
    directions = solid.centre + np.random.default_rng(0).uniform(-0.5, 0.5, (count, 3)) * solid.extent - origin
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def hit_places(solid, origin):
    """Where rays from the origin hit the solid, in its own coordinates."""
    directions = rays_at(solid, origin)
    ranges = solid.ranges(origin, directions)
    hit = np.isfinite(ranges)
    return (origin + directions[hit] * ranges[hit, None] - solid.centre) @ solid.rotation


def test_an_ellipsoid_is_hit_on_its_near_side():
    solid = Ellipsoid(np.array([0.0, 3.0, 0.5]), EXTENT)
    places = hit_places(solid, ORIGIN)
    assert len(places) > 1000
    np.testing.assert_allclose(((2 * places / EXTENT) ** 2).sum(axis=1), 1)
    assert (places @ solid.centre < 0.15).all()
    assert solid.contains(solid.centre + 0.99 * places).all() and not solid.contains(solid.centre + 1.01 * places).any()


@pytest.mark.parametrize("kind", [Bowl, Cup])
def test_an_open_vessel_is_seen_from_inside_and_from_outside(kind):
    solid = kind(np.array([0.0, 1.0, 0.0]), EXTENT)
    above, beside = solid.centre - [0.0, 0.0, -2.0], solid.centre - [0.0, 2.0, 0.0]
    inside = hit_places(solid, above)
    assert inside[:, 2].min() < -0.2 and np.median(inside[:, 2]) < 0
    assert (hit_places(solid, beside)[:, 1] < 0.2).mean() > 0.9
    down = np.array([[0.0, 0.0, -1.0]])
    np.testing.assert_allclose(solid.ranges(above, down), 2 + EXTENT[2] / 2)
    # From below it is closed.
    np.testing.assert_allclose(solid.ranges(solid.centre - [0.0, 0.0, 2.0], -down), 2 - EXTENT[2] / 2)


def test_leaves_stop_rays_at_depths_that_differ_from_ray_to_ray():
    solid = Vegetation(np.array([0.0, 3.0, 0.0]), np.ones(3), free_path=0.4)
    directions = rays_at(solid, ORIGIN, 20_000)
    straight = np.arccos(directions[:, 1]) < 0.02
    ranges = solid.ranges(ORIGIN, directions)
    through = np.isinf(ranges[straight]).mean()
    assert through == pytest.approx(np.exp(-1 / 0.4), abs=0.06)
    depths = ranges[straight & np.isfinite(ranges)] - 2.5
    assert depths.min() >= -0.01 and depths.max() <= 1.01 and depths.std() > 0.15
    np.testing.assert_array_equal(solid.ranges(ORIGIN, directions), ranges)


@pytest.mark.parametrize("origin", [(0.0, -12.0, 3.0), (2.0, 1.0, 30.0), (0.0, 0.0, 1.6)])
def test_ground_is_hit_where_its_height_is(origin):
    ground = Ground(np.zeros(3), np.array([20.0, 20.0, 3.0]), heights=HILLS)
    places = hit_places(ground, np.array(origin))
    assert len(places) > 300
    np.testing.assert_allclose(places[:, 2], ground.height_at(places[:, :2]), atol=0.002)
    assert ground.contains(places, 0.05).all() and not ground.contains(places - [0.0, 0.0, -0.1], 0.01).any()


@pytest.mark.parametrize("kind", [Solid, Ellipsoid, Bowl, Cup])
def test_a_motion_moves_what_rays_hit(kind):
    solid = kind(np.array([0.2, 2.0, 0.3]), EXTENT, yaw=0.4)
    motion = rigid_transform(Rotation.from_rotvec([0.5, -1.0, 0.3]).as_matrix(), np.array([1.0, 2.0, 3.0]))
    directions = rays_at(solid, ORIGIN)
    expected, _ = cast([solid], ORIGIN, directions)
    found, _ = cast([solid.moved(motion)], motion[:3, 3], directions @ motion[:3, :3].T)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    np.testing.assert_allclose(solid.moved(motion).pose(), motion @ solid.pose(), atol=1e-12)
