import numpy as np

from gmmjax.scenes.families.arrangements import Arrangement, cuboid, displaced, pose_with_clearance
from gmmjax.scenes.families.staging import Support, turned

CRATE = (cuboid((0.0, 0.0, 0.2), (0.4, 0.4, 0.4)), cuboid((0.0, 0.0, 0.5), (0.2, 0.2, 0.2)))


def labels(solids):
    return [solid.label for solid in solids]


def test_every_change_has_its_number_on_the_sides_where_it_is():
    arrangement = Arrangement()
    arrangement.stays(CRATE)
    arrangement.goes(CRATE)
    arrangement.moves(CRATE, turned(0.5, (1.0, 2.0, 0.0)))
    arrangement.comes(CRATE)
    assert labels(arrangement.solids.before) == [-1, -1, 0, 0, 1, 1]
    assert labels(arrangement.solids.after) == [-1, -1, 1, 1, 2, 2]
    np.testing.assert_allclose(arrangement.solids.after[2].centre, [1.0, 2.0, 0.2])


def test_what_comes_later_keeps_the_clearance():
    random, support = np.random.default_rng(0), Support(np.eye(4), (4.0, 4.0), gap=0.0)
    radius = np.hypot(0.2, 0.2)
    first = pose_with_clearance(support, random, CRATE, 0.5)
    others = [pose for _ in range(8) if (pose := support.pose(random, CRATE)) is not None]
    assert len(others) > 2
    assert min(np.linalg.norm(pose[:2, 3] - first[:2, 3]) for pose in others) > 2 * radius + 0.5


def test_a_thing_is_displaced_on_its_plane_by_a_length_within_the_range():
    random = np.random.default_rng(0)
    pose = turned(0.7, (1.0, -2.0, 0.4))
    for _ in range(20):
        there = displaced(random, pose, (0.02, 0.15), 0.1) @ pose
        assert 0.02 <= np.linalg.norm((there - pose)[:3, 3]) <= 0.15 and there[2, 3] == 0.4
        assert np.arccos(np.clip((np.trace(there[:3, :3] @ pose[:3, :3].T) - 1) / 2, -1, 1)) <= 0.1 + 1e-6
