import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.cloud_changes import change_of
from gmmjax.changes.objects.moved import with_moved
from gmmjax.changes.objects.support_plane import support_planes
from gmmjax.changes.objects.upright import UprightSettings, stays_upright, upright_searches
from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.geometry.rigid import transformed
from gmmjax.pair import Pair
from tests.changes.scanned_objects import level, motion, on_floor_and_shelf, registered, standing

NOISE = 0.003


def planes_of(objects, background):
    return Pair(*support_planes([LocalSurface.of(points) for points in objects], background, NOISE))


@pytest.fixture(scope="module")
def scene():
    return on_floor_and_shelf()


def test_an_object_stays_upright_when_it_is_put_elsewhere(scene):
    objects, background = scene
    planes = planes_of(objects, background)
    middle, reach = objects[1].mean(axis=0), 3 * NOISE
    carried = motion(1.2, [1.0, 0.0, 0.6])
    assert stays_upright(carried, planes, middle, reach)
    sunk = motion(1.2, [1.0, 0.0, 0.57])
    assert not stays_upright(sunk, planes, middle, reach)
    tilted = carried.copy()
    tilted[:3, :3] = Rotation.from_euler("x", 40, degrees=True).as_matrix() @ carried[:3, :3]
    tilted[:3, 3] += middle - transformed(middle[None] - [1.0, 0.0, 0.6], tilted)[0]
    assert not stays_upright(tilted, planes, middle, reach)


def test_all_starts_keep_it_upright(scene):
    objects, background = scene
    planes = planes_of(objects, background)
    for search in upright_searches(Pair(*(LocalSurface.of(points) for points in objects)), planes):
        angles = {round(float(np.degrees(Rotation.from_matrix(start[:3, :3]).magnitude()))) for start in search.starts}
        assert len(angles) > 10
        for start in search.starts:
            assert stays_upright(start, planes, objects[1].mean(axis=0), 1e-6)
            np.testing.assert_allclose(start[:3, :3] @ start[:3, :3].T, np.eye(3), atol=1e-12)


def test_one_search_brings_the_tops_together(scene):
    """Of one box the sides at +x and +y were seen, of the other one those at -x and -y."""
    planes = planes_of(*scene)
    ends = [standing(0, faces=(0, 1, 2)), standing(1, faces=(2, 3, 4), height=0.6, middle=(1.0, 0.0))]
    parts = Pair(*(LocalSurface.of(points) for points in ends))
    whole, tops = (
        np.linalg.norm(search.starts[0][:3, 3] - [1.0, 0.0, 0.6]) for search in upright_searches(parts, planes)
    )
    assert tops < 0.02 < whole
    (only,) = upright_searches(parts, planes, UprightSettings(lowest_top=1.1))
    assert only.whole


def kinds(gone, new, floors):
    """What becomes of two changes in a scene."""
    before, after = np.concatenate([gone, floors[0]]), np.concatenate([new, floors[1]])
    items = change_of(gone, "disappeared", 1.0, 10.0), change_of(new, "appeared", 1.0, 10.0)
    labels = [np.where(np.arange(len(cloud)) < own, index, -1) for index, (cloud, own) in
              enumerate([(before, len(gone)), (after, len(new))])]  # fmt: skip
    moved, _ = with_moved(items, Pair(*labels), registered(before, after), NOISE)
    return [change.kind for change in moved]


def test_a_lower_box_of_the_same_outline_is_another_one():
    """Top on top it would be sunk into the floor, and where it would stand its top is too low."""
    gone, other = standing(0), standing(1, (0.4, 0.28, 0.19), middle=(0.3, 0.5), yaw=0.4)
    floors = level(2, 0.0, hole=gone), level(3, 0.0, hole=other)
    assert kinds(gone, other, floors) == ["disappeared", "appeared"]
    assert kinds(gone, standing(1, middle=(0.3, 0.5), yaw=0.4), floors) == ["moved", "moved"]


def test_one_object_is_recognised_by_its_top():
    """Seen from opposite corners, its sides have nothing in common."""
    gone, new = standing(0, faces=(0, 1, 2)), standing(1, middle=(0.4, 0.4), yaw=2.0, faces=(2, 3, 4))
    floors = level(2, 0.0, hole=gone), level(3, 0.0, hole=new)
    assert kinds(gone, new, floors) == ["moved", "moved"]
