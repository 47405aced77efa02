"""The size of a crate on a floor that a scanner saw three sides of."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.align.alignment import aligned
from gmmjax.changes.objects.cloud_changes import change_of
from gmmjax.changes.objects.measures import measure_changes
from gmmjax.changes.total_volumes import volume_totals
from gmmjax.pair import Pair

CRATE = np.array([0.8, 0.5, 0.6])
SPACING = 0.03
MEASURED = {"box", "area", "volume", "volume_error", "volume_registration_error", "volume_method", "gain_or_loss"}
TURN = np.radians(25)
ROTATION = np.array([[np.cos(TURN), -np.sin(TURN), 0], [np.sin(TURN), np.cos(TURN), 0], [0, 0, 1]])


def sheet(first, second, count=None):
    grid = np.stack(np.meshgrid(np.arange(0, first, SPACING), np.arange(0, second, SPACING)), axis=-1)
    return grid.reshape(-1, 2)


def three_sides():
    """Of the crate: the top and two sides, the lowest 5 cm of which look like the floor."""
    x, y, z = CRATE
    top = np.insert(sheet(x, y), 2, z, axis=1)
    front = np.insert(sheet(x, z), 1, 0.0, axis=1)
    left = np.insert(sheet(y, z), 0, 0.0, axis=1)
    points = np.concatenate([top, front, left])
    return points[points[:, 2] > 0.05]


@pytest.fixture(scope="module")
def crate():
    """The crate's points, and the floor with it; a centimetre of tilt so that no axis is special."""
    random = np.random.default_rng(0)
    floor = np.insert(sheet(4.0, 4.0) - 2, 2, 0.0, axis=1)
    points = (three_sides() - [CRATE[0] / 2, CRATE[1] / 2, 0]) @ ROTATION.T
    # Nobody sees the floor below the crate.
    x, y = np.abs((floor @ ROTATION)[:, :2]).T
    bare = floor[(x > CRATE[0] / 2) | (y > CRATE[1] / 2)]
    noisy = [own + random.normal(0, 0.001, own.shape) for own in (floor, bare, points)]
    return noisy


def measured_crate(crate, motion=np.eye(3), shift=np.zeros(3)):
    before, floor, points = (own @ motion.T + shift for own in crate)
    pair = aligned(Pair(before, np.concatenate([floor, points])), "never")
    labels = Pair(np.full(len(before), -1), np.repeat([-1, 0], [len(floor), len(points)]))
    change = change_of(points, "appeared", 0.9, 5.0)
    return measure_changes((change,), labels, pair, 0.001, Pair(None, None), "up")[0]


def test_a_crate_that_three_sides_were_seen_of_has_its_size_and_its_volume(crate):
    found = measured_crate(crate)
    np.testing.assert_allclose(found.box.extent, np.sort(CRATE)[::-1], atol=SPACING)
    np.testing.assert_allclose(found.box.centre, [0, 0, CRATE[2] / 2], atol=SPACING)
    assert found.volume == pytest.approx(np.prod(CRATE), rel=0.15)
    assert abs(found.volume - np.prod(CRATE)) < found.volume_error < 0.3 * np.prod(CRATE)
    assert (found.volume_method, found.gain_or_loss) == ("surface", "gain")


def test_of_an_object_whose_ground_nobody_saw_the_hull_is_measured_and_no_interval_is_made_up(crate):
    """The other scan has nothing below it: as a change in a gap of that scan."""
    before, floor, points = crate
    found = measured_crate([before[(np.abs(before[:, :2]) > 0.7).any(axis=1)], floor, points])
    assert found.volume == pytest.approx(np.prod(CRATE), rel=0.1)
    assert (found.volume_method, found.volume_error, found.gain_or_loss) == ("hull", None, "gain")
    assert found.area == pytest.approx(CRATE[0] * CRATE[1], rel=0.1)


def test_size_and_volume_do_not_depend_on_the_frame(crate):
    tilt = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]) @ ROTATION
    shift = np.array([4.5e5, 5.4e6, 120.0])
    found, moved = measured_crate(crate), measured_crate(crate, tilt, shift)
    np.testing.assert_allclose(moved.box.extent, found.box.extent, atol=1e-6)
    np.testing.assert_allclose(moved.box.centre, tilt @ found.box.centre + shift, atol=1e-6)
    assert moved.volume == pytest.approx(found.volume, rel=1e-6)


def test_outliers_do_not_enlarge_a_change(crate):
    before, floor, points = crate
    strays = np.array([[0, 0, 3.0], [0, 0, 3.02], [1.5, 0, 2.0], [-2.0, 1.0, 1.0], [0, 2.0, 2.5]])
    found = measured_crate([before, floor, np.concatenate([points, strays])])
    np.testing.assert_allclose(found.box.extent, measured_crate(crate).box.extent, atol=SPACING)
    assert found.point_count == len(points) + len(strays)


def test_a_change_of_points_that_are_repeated_is_measured(crate):
    before, floor, points = crate
    found = measured_crate([before, floor, np.repeat(points, 12, axis=0)])
    np.testing.assert_allclose(found.box.extent, measured_crate(crate).box.extent, atol=SPACING)


def test_without_a_support_plane_the_box_is_that_of_the_points(crate, monkeypatch):
    monkeypatch.setattr("gmmjax.changes.objects.support_plane.CONTACT", 0.0)
    found = measured_crate(crate)
    np.testing.assert_allclose(np.sort(found.box.extent), np.sort(CRATE - [0, 0, 0.05]), atol=SPACING)


def test_nothing_else_of_the_change_is_altered(crate):
    found = measured_crate(crate)
    before = change_of(crate[2], "appeared", 0.9, 5.0)
    for name in {field.name for field in dataclasses.fields(before)} - MEASURED:
        np.testing.assert_equal(getattr(found, name), getattr(before, name))


def test_what_lies_far_above_a_change_is_no_surface_below_it(crate):
    """A shelf in both scans, above one end of the crate."""
    random = np.random.default_rng(2)
    shelf = np.insert(sheet(0.8, 2.0) + np.array([0.15, -1.0]), 2, 2.5 * CRATE[2], axis=1) @ ROTATION.T
    shelf += random.normal(0, 0.001, shelf.shape)
    before, floor, points = crate
    found = measured_crate([np.concatenate([before, shelf]), np.concatenate([floor, shelf]), points])
    assert (found.volume_method, found.gain_or_loss) == ("surface", "gain")
    assert found.volume == pytest.approx(measured_crate(crate).volume, rel=0.05)


def in_shadow(points, station):
    """Which points of the floor the crate hides from a station."""
    steps = np.linspace(0, 1, 200)[:, None, None]
    along = (points @ ROTATION)[None] + steps * (station - points @ ROTATION)[None]
    inside = (np.abs(along[..., 0]) < CRATE[0] / 2) & (np.abs(along[..., 1]) < CRATE[1] / 2)
    return (inside & (along[..., 2] < CRATE[2])).any(axis=0)


def test_the_shadow_of_a_crate_is_not_of_the_crate(crate):
    """Nobody sees the floor behind it from the corner in front of the two sides that were seen."""
    before, floor, points = crate
    shaded = before, floor[~in_shadow(floor, np.array([-2.0, -2.0, 1.5]))], points
    found = measured_crate(shaded)
    assert found.volume == pytest.approx(np.prod(CRATE), rel=0.1)
    assert abs(found.volume - np.prod(CRATE)) < found.volume_error < 0.3 * np.prod(CRATE)


def test_the_wall_of_a_pit_alone_has_no_volume_and_is_no_gain():
    """The far wall of a pit in a slope, seen from the foot of it: that is all that is labelled."""
    random = np.random.default_rng(1)
    before, after = (random.uniform([-4, -4, 0], [4, 4, 0], (12_000, 3)) for _ in range(2))
    wall = random.uniform([-1, 1, -0.8], [1, 1.02, 0], (600, 3))
    dug = (np.abs(after[:, :2]) < 1).all(axis=1)
    # Of its floor a strip before the wall is seen.
    after[dug, 2] = -0.8
    after = after[~dug | (after[:, 1] > 0.4)]
    slope = Rotation.from_euler("x", 25, degrees=True).as_matrix().T
    before, after, wall = ((own + random.normal(0, 0.004, own.shape)) @ slope for own in (before, after, wall))
    pair = aligned(Pair(before, np.concatenate([after, wall])), "never")
    labels = Pair(np.full(len(before), -1), np.repeat([-1, 0], [len(after), len(wall)]))
    change = change_of(wall, "appeared", 0.9, 5.0)
    station = np.array([[0.0, -12.0, -4.0]])
    found = measure_changes((change,), labels, pair, 0.001, Pair(station, station), "sensor")[0]
    assert (found.volume, found.gain_or_loss) == (None, None)


@pytest.mark.parametrize(
    ("kind", "station", "expected"),
    [("moved", None, "loss"), ("disappeared", None, None), ("disappeared", (0.0, -5.0, 0.5), "loss")],
)
def test_what_moved_without_known_poses_left_less_behind(kind, station, expected):
    """The front of a box before a wall."""
    random = np.random.default_rng(2)
    wall = random.uniform([-1, 0, -1], [1, 0, 1], (6000, 3))
    front = random.uniform([-0.2, -0.2, -0.2], [0.2, -0.2, 0.2], (600, 3))
    bare = wall[(np.abs(wall[:, [0, 2]]) > 0.2).any(axis=1)]
    before, after = (own + random.normal(0, 0.001, own.shape) for own in (np.concatenate([bare, front]), wall))
    pair = aligned(Pair(before, after), "never")
    labels = Pair(np.repeat([-1, 0], [len(bare), len(front)]), np.full(len(after), -1))
    sensors = None if station is None else np.array([station])
    change = change_of(before[len(bare) :], kind, 0.9, 5.0)
    side = "up" if station is None else "sensor"
    found = measure_changes((change,), labels, pair, 0.001, Pair(sensors, sensors), side)[0]
    assert found.gain_or_loss == expected
    assert found.volume == pytest.approx(0.2 * 0.4**2, rel=0.15)


def board(gap, *, hides):
    """A board of 0.6 m by 0.4 m by 0.1 m that came before a wall, seen from the front and from both sides.

    Args:
        gap: between the wall and the board.
        hides: whether nobody sees the wall behind it.
    """
    random = np.random.default_rng(3)
    walls = [random.uniform([-1.5, 0, -1.5], [1.5, 0, 1.5], (9000, 3)) for _ in range(2)]
    front = random.uniform([-0.3, -0.1, -0.2], [0.3, -0.1, 0.2], (600, 3))
    sides = [random.uniform([x, -0.1, -0.2], [x, 0.0, 0.2], (100, 3)) for x in (-0.3, 0.3)]
    points = np.concatenate([front, *sides]) - [0, gap, 0]
    if hides:
        walls[1] = walls[1][(np.abs(walls[1][:, [0, 2]]) > [0.3, 0.2]).any(axis=1)]
    before, wall, points = (own + random.normal(0, 0.001, own.shape) for own in (*walls, points))
    pair = aligned(Pair(before, np.concatenate([wall, points])), "never")
    labels = Pair(np.full(len(before), -1), np.repeat([-1, 0], [len(wall), len(points)]))
    change = change_of(points, "appeared", 0.9, 5.0)
    return measure_changes((change,), labels, pair, 0.001, Pair(None, None), "up")[0]


def test_between_what_hangs_and_the_wall_behind_it_nothing_was_gained():
    volume = 0.6 * 0.4 * 0.1
    found = board(0.4, hides=False)
    assert (found.volume_method, found.gain_or_loss) == ("hull", "gain")
    assert abs(found.volume - volume) < 0.1 * volume


def test_what_hides_the_wall_behind_it_reaches_to_the_wall():
    assert board(0.4, hides=True).volume == pytest.approx(0.6 * 0.4 * 0.5, rel=0.15)
    assert board(0.0, hides=True).volume_method == "surface"


def cut_and_fill(before_shows, after_shows):
    """Ground that was lowered by 0.2 m in one place and raised by 0.2 m beside it, of which each scan shows a part.

    Args:
        before_shows: from where to where along x the before scan's points are labelled.
        after_shows: likewise.
    """
    random = np.random.default_rng(4)
    before, after = (random.uniform([-4, -4, 0], [4, 4, 0], (14_000, 3)) for _ in range(2))
    inside = (np.abs(after[:, 0]) < 1.5) & (np.abs(after[:, 1]) < 1)
    after[inside, 2] = 0.2 * np.sign(after[inside, 0])
    before, after = (own + random.normal(0, 0.004, own.shape) for own in (before, after))

    def labelled(points, shows, number):
        low, high = shows
        rows = (points[:, 0] > low) & (points[:, 0] < high) & (np.abs(points[:, 1]) < 1)
        return np.where(rows, number, -1)

    labels = Pair(labelled(before, before_shows, 0), labelled(after, after_shows, 1))
    changes = [
        change_of(own[label >= 0], kind, 0.9, 5.0)
        for own, label, kind in zip((before, after), labels, ("disappeared", "appeared"), strict=True)
    ]
    return measure_changes(tuple(changes), labels, aligned(Pair(before, after), "never"), 0.001, Pair(None, None), "up")


@pytest.mark.parametrize("parts", [((-1.5, 1.2), (-1.2, 1.5)), ((-1.5, 1.5), (-0.2, 1.5))])
def test_cut_and_fill_that_both_scans_show_has_both_volumes_once(parts):
    changes = cut_and_fill(*parts)
    totals = volume_totals(changes)
    assert sum(change.volume_counted_in is not None for change in changes) == 1
    for found, error in ((totals.gained, totals.gained_error), (totals.lost, totals.lost_error)):
        assert found == pytest.approx(1.5 * 2 * 0.2, rel=0.1)
        assert error < 0.2 * found
