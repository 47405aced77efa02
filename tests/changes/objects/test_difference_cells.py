"""The volume between two surfaces, of lenses of ground whose volume is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.difference_cells import DifferenceCells, Grid, spacing_of
from gmmjax.pair import Pair

EDGE, POINTS = 8.0, 5000
RADIUS, THICKNESS, NOISE = 1.5, 0.2, 0.01
# Of a paraboloid.
VOLUME = np.pi / 2 * RADIUS**2 * THICKNESS
NOTHING = np.empty((0, 3))


def ground(random, thickness=0.0, middle=0.0):
    """A hilly floor with a lens on it, or taken from it, and how thick that is at each point."""
    points = random.uniform([-EDGE / 2, -EDGE / 2, 0], [EDGE / 2, EDGE / 2, 0], (POINTS, 3))
    lens = thickness * np.clip(1 - ((points[:, :2] - [middle, 0]) ** 2).sum(axis=1) / RADIUS**2, 0, None)
    hills = 0.2 * np.sin(points[:, 0]) + 0.1 * np.cos(1.3 * points[:, 1])
    points[:, 2] = hills + lens + random.normal(0, NOISE, len(points))
    return points, lens


def cells_of(before, after, labelled, motion=np.eye(3), others=NOTHING, background=NOTHING):
    """The cells of a change of the after scan."""
    before, after, labelled, others, background = (
        own @ motion.T for own in (before, after, labelled, others, background)
    )
    # As changes are measured: of each scene the outline lies elsewhere in the cells.
    spacing, reach = spacing_of(labelled), np.sqrt(len(labelled) / np.pi) + 6
    grid = Grid.about(labelled, motion[:, 2], spacing, labelled, reach * spacing)
    return DifferenceCells.of(grid, Pair(NOTHING, labelled), Pair(before, after), others, background, after=True)


def measured(seed=0, thickness=THICKNESS, motion=np.eye(3), scale=1.0, limit=0.05, error=0.0):
    """The volume of a lens of which the part thicker than the limit is labelled."""
    random = np.random.default_rng(seed)
    before, _ = ground(random)
    after, lens = ground(random, thickness)
    cells = cells_of(scale * before, scale * after, scale * after[np.abs(lens) > limit], motion)
    (found,) = cells.volumes(scale * error, whole=True)
    return found, cells


@pytest.mark.parametrize("thickness", [THICKNESS, -THICKNESS, 0.5])
def test_a_lens_has_its_volume_with_the_thin_edge_that_is_not_labelled(thickness):
    true = VOLUME * thickness / THICKNESS
    found, cells = measured(thickness=thickness)
    assert found.gain == pytest.approx(true, rel=0.06)
    assert cells.area == pytest.approx(np.pi * RADIUS**2 * (1 - 0.05 / abs(thickness)), rel=0.08)
    assert not cells.closed


def test_the_interval_holds_in_most_scenes():
    found = [measured(seed)[0] for seed in range(40)]
    assert np.mean([abs(own.gain - VOLUME) <= own.error for own in found]) >= 0.85
    # And is no wider than it need be.
    assert np.median([own.error for own in found]) < 4 * np.std([own.gain for own in found])


def test_the_registration_error_is_common_to_all_cells():
    (found, cells), (sure, _) = measured(error=0.01), measured()
    assert sure.registration_error == 0
    assert found.registration_error >= 1.96 * 0.01 * cells.area
    assert found.error == pytest.approx(np.hypot(sure.error, found.registration_error), rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_a_rigid_motion_changes_nothing_and_a_unit_the_cube(seed):
    motion = Rotation.random(rng=seed).as_matrix()
    found, moved, larger = measured(seed)[0], measured(seed, motion=motion)[0], measured(seed, scale=1000.0)[0]
    np.testing.assert_allclose(moved, found, rtol=1e-6)
    np.testing.assert_allclose(larger, 1e9 * np.array(found), rtol=1e-6)


def test_of_two_changes_that_adjoin_each_has_its_own():
    random = np.random.default_rng(3)
    before, _ = ground(random)
    after, lens = ground(random, THICKNESS)
    halves = [after[(lens > 0.05) & side] for side in (after[:, 0] < 0, after[:, 0] >= 0)]
    gains = [
        cells_of(before, after, own, others=other).volumes(0.0, whole=True)[0].gain
        for own, other in (halves, halves[::-1])
    ]
    assert sum(gains) == pytest.approx(VOLUME, rel=0.2)
    np.testing.assert_allclose(gains, VOLUME / 2, rtol=0.25)


@pytest.mark.parametrize("lost", [0.35, 0.15])
def test_what_was_gained_and_what_was_lost_beside_it_are_two_volumes(lost):
    random = np.random.default_rng(0)
    before, _ = ground(random)
    gained, first = ground(random, THICKNESS, -1.25)
    after = gained.copy()
    second = lost * np.clip(1 - ((after[:, :2] - [1.25, 0]) ** 2).sum(axis=1) / RADIUS**2, 0, None)
    after[:, 2] -= second
    cells = cells_of(before, after, after[np.abs(first - second) > 0.05])
    found = cells.volumes(0.0, whole=False)
    true = sorted((VOLUME, -VOLUME * lost / THICKNESS), key=abs, reverse=True)
    np.testing.assert_allclose([own.gain for own in found], true, rtol=0.15)
    assert len(cells.volumes(0.0, whole=True)) == 1


def test_an_object_that_only_sides_were_seen_of_has_no_volume_between_surfaces():
    random = np.random.default_rng(1)
    before, _ = ground(random)
    wall = random.uniform([-1, -0.01, 0.2], [1, 0.01, 2.0], (800, 3))
    assert cells_of(before, np.concatenate([before, wall]), wall).closed


def test_what_its_own_scan_sees_the_ground_behind_is_closed():
    random = np.random.default_rng(2)
    before, _ = ground(random)
    lamp = random.uniform([-1, -1, 2.0], [1, 1, 2.05], (800, 3))
    after, _ = ground(random)
    assert cells_of(before, np.concatenate([after, lamp]), lamp, background=after).closed
    assert not cells_of(before, np.concatenate([after, lamp]), lamp).closed


def test_beside_what_stands_on_it_the_ground_that_one_scan_did_not_see_has_no_difference():
    random = np.random.default_rng(4)
    before, _ = ground(random)
    after, lens = ground(random, 0.5)
    seen = ~((after[:, 0] > 0.5) & (np.abs(after[:, 1]) < 1))
    cells = cells_of(before, after[seen], after[seen & (lens > 0.05)])
    (found,) = cells.volumes(0.0, whole=True)
    assert np.isnan(cells.difference).any() and 0 < found.gain < 2.5 * VOLUME
