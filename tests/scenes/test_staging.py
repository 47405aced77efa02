import numpy as np
import pytest

from gmmjax.clouds import SensorViews
from gmmjax.scenes import Beam
from gmmjax.scenes.families.scanners import Flight
from gmmjax.scenes.families.staging import Arrangement, Support, Turnover, displaced
from gmmjax.scenes.families.things import box, cuboid, footprint, height, moved, rack, rod
from gmmjax.scenes.rigid_motions import turned

CRATE = (cuboid((0.0, 0.0, 0.2), (0.4, 0.4, 0.4)), cuboid((0.0, 0.0, 0.5), (0.2, 0.2, 0.2)))


def test_every_change_has_its_number_on_the_sides_where_it_is():
    arrangement = Arrangement()
    arrangement.stays(CRATE)
    arrangement.comes_or_goes(CRATE, comes=False)
    arrangement.moves(CRATE, turned(0.5, (1.0, 2.0, 0.0)))
    arrangement.comes_or_goes(CRATE, comes=True)
    labels = arrangement.solids.map(lambda solids: [solid.label for solid in solids])
    assert labels.before == [-1, -1, 0, 0, 1, 1] and labels.after == [-1, -1, 1, 1, 2, 2]
    np.testing.assert_allclose(arrangement.solids.after[2].centre, [1.0, 2.0, 0.2])


def test_nothing_changes_in_a_third_of_the_scenes():
    drawn = [Turnover().drawn(np.random.default_rng(seed)) for seed in range(300)]
    assert np.mean([counts == (0, 0, 0) for counts in drawn]) == pytest.approx(1 / 3, abs=0.1)
    assert {max(counts) for counts in drawn} == {0, 1, 2, 3}


def test_things_stand_apart_and_on_their_support():
    random = np.random.default_rng(0)
    support = Support(turned(0.5, (1.0, 2.0, 0.7)), (3.0, 2.0))
    things = [box(random) for _ in range(12)]
    poses = [support.pose(random, thing) for thing in things]
    standing = [moved(thing, pose) for thing, pose in zip(things, poses, strict=True) if pose is not None]
    assert len(standing) > 4
    for thing in standing:
        assert thing[0].centre[2] - thing[0].extent[2] / 2 == pytest.approx(0.7)
        near = [other for other in standing if other is not thing and other[0].contains(thing[0].centre[None], 0.05)]
        assert not near
    assert Support(np.eye(4), (3.0, 2.0), headroom=0.05).pose(random, things[0]) is None


def test_what_comes_later_keeps_the_clearance():
    apart = []
    for seed in range(8):
        random, support = np.random.default_rng(seed), Support(np.eye(4), (4.0, 4.0), gap=0.0)
        first = support.pose(random, CRATE, clearance=0.5)
        others = [pose for _ in range(8) if (pose := support.pose(random, CRATE)) is not None]
        apart += [np.linalg.norm(pose[:2, 3] - first[:2, 3]) for pose in others]
    assert len(apart) > 16 and min(apart) > 2 * np.hypot(0.2, 0.2) + 0.5


def test_a_thing_is_displaced_on_its_plane_by_a_length_within_the_range():
    random, pose = np.random.default_rng(0), turned(0.7, (1.0, -2.0, 0.4))
    for _ in range(20):
        there = displaced(random, pose, (0.02, 0.15), 0.1) @ pose
        assert 0.02 <= np.linalg.norm((there - pose)[:3, 3]) <= 0.15 and there[2, 3] == 0.4
        assert np.arccos(np.clip((np.trace(there[:3, :3] @ pose[:3, :3].T) - 1) / 2, -1, 1)) <= 0.1 + 1e-6


def test_rods_lie_on_the_floor():
    random = np.random.default_rng(0)
    for thing in (rod(random) for _ in range(20)):
        lowest = min(float(solid.centre[2] - (np.abs(solid.rotation) @ solid.extent)[2] / 2) for solid in thing)
        assert lowest == pytest.approx(0, abs=1e-12)
        assert height(thing) <= 0.26 and 0.4 <= footprint(thing) <= 2.5


@pytest.mark.parametrize("levels", [1, 3])
def test_the_first_solids_of_a_rack_are_its_decks_from_the_lowest_on(levels):
    thing = rack(np.random.default_rng(0), levels)
    decks, others = thing[:levels], thing[levels:]
    step = decks[0].centre[2]
    np.testing.assert_allclose([deck.centre[2] for deck in decks], step * np.arange(1, levels + 1), atol=0.05)
    # Boards as wide as the rack; of beams and posts none is both wide and deep.
    assert all(min(deck.extent[:2]) > 0.7 for deck in decks)
    assert all(min(own.extent[:2]) < 0.1 for own in others)
    assert height(thing) > decks[-1].centre[2]


@pytest.mark.parametrize(("lines", "heading"), [(1, 0.0), (3, 0.0), (2, 0.8)])
def test_a_flight_sees_the_whole_area_beneath_with_rays_that_its_scans_share(lines, heading):
    flight = Flight(edge=80.0, altitude=300.0, lines=lines, overlap=0.2, heading=heading)
    scanner = flight.scanner(Beam(max_range=900.0), rays=24_000.0)
    assert scanner.rays == 24_000 // 6 // lines
    views = SensorViews(flight.poses(), (scanner.across, scanner.along), 900.0)
    steps = np.linspace(-39.9, 39.9, 30)
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    places = np.column_stack([x, y, np.zeros(len(x))]) @ turned(heading)[:3, :3].T
    covered = [views.in_field_of_view(views.in_camera(places, view)) for view in range(len(views))]
    assert np.any(covered, axis=0).all()
    assert len(views) == 6 * lines
