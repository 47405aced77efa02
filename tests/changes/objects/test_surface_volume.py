"""The volume between two surfaces, of lenses of ground whose volume is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.change_surface import ChangeSurface
from gmmjax.changes.objects.surface_volume import SurfaceMap, SurfaceVolumeSettings, volumes_of
from gmmjax.changes.objects.surroundings_offset import OffsetSettings
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair

EDGE, POINTS = 8.0, 5000
RADIUS, THICKNESS, NOISE = 1.5, 0.2, 0.01
# Of a paraboloid.
VOLUME = np.pi / 2 * RADIUS**2 * THICKNESS
UP = np.array([0, 0, 1.0])
NOTHING = np.empty((0, 3))


def ground(random, thickness=0.0, offset=0.0, seen=None):
    """A hilly floor with a lens on it, or taken from it, and how thick that is at each point."""
    points = random.uniform([-EDGE / 2, -EDGE / 2, 0], [EDGE / 2, EDGE / 2, 0], (POINTS, 3))
    if seen is not None:
        points = points[seen(points)]
    lens = thickness * np.clip(1 - (points[:, :2] ** 2).sum(axis=1) / RADIUS**2, 0, None)
    hills = 0.3 * np.sin(points[:, 0]) + 0.2 * np.cos(1.3 * points[:, 1])
    points[:, 2] = hills + lens + offset + random.normal(0, NOISE, len(points))
    return points, lens


def measured(seed=0, thickness=THICKNESS, offset=0.0, motion=np.eye(3), scale=1.0, limit=0.05, seen=None):
    """The volume of a lens of which the part thicker than the limit is labelled."""
    random = np.random.default_rng(seed)
    before, _ = ground(random)
    after, lens = ground(random, thickness, offset, seen)
    clouds = Pair(before, after).map(lambda own: scale * own @ motion.T)
    labelled = clouds.after[np.abs(lens) > limit]
    change = ChangeSurface(Pair(NOTHING, labelled), clouds, NOTHING, LocalSurface.of(clouds.before), motion @ UP)
    return SurfaceMap.of(change, scale * 0.005).volume()


@pytest.mark.parametrize("thickness", [THICKNESS, -THICKNESS, 0.5])
def test_a_lens_has_its_volume_with_the_rim_that_is_not_labelled(thickness):
    true = VOLUME * thickness / THICKNESS
    found = measured(thickness=thickness)
    assert found.gain == pytest.approx(true, rel=0.03)
    assert abs(found.gain - true) < found.error < 0.05 * abs(true)
    labelled = np.pi * RADIUS**2 * (1 - 0.05 / abs(thickness))
    assert found.area == pytest.approx(labelled, rel=0.06)


def test_the_interval_holds_in_most_scenes():
    found = [measured(seed) for seed in range(40)]
    held = np.mean([abs(own.gain - VOLUME) <= own.error for own in found])
    assert 0.85 <= held
    # And is no wider than it need be.
    assert np.median([own.error for own in found]) < 3 * np.std([own.gain for own in found])


def test_what_both_scans_differ_by_around_the_change_is_taken_off():
    apart = measured(offset=0.01)
    assert apart.gain == pytest.approx(measured().gain, rel=0.005)
    # The offset would be a fifth of a thinner lens, to which there are no surroundings here.
    alone = SurfaceVolumeSettings(offset=OffsetSettings(fewest_blocks=10**6))
    random = np.random.default_rng(0)
    before, _ = ground(random)
    after, lens = ground(random, offset=0.01, thickness=THICKNESS)
    change = ChangeSurface(Pair(NOTHING, after[lens > 0.05]), Pair(before, after), NOTHING, LocalSurface.of(before), UP)
    found = SurfaceMap.of(change, 0.01, alone).volume(alone)
    assert found.gain > apart.gain
    assert found.registration_error > 10 * apart.registration_error
    assert abs(found.gain - VOLUME) < found.error


@pytest.mark.parametrize("seed", range(3))
def test_a_rigid_motion_changes_nothing_and_a_unit_the_cube(seed):
    motion = Rotation.random(rng=seed).as_matrix()
    found, moved = measured(seed), measured(seed, motion=motion, scale=1000.0)
    for name, power in (("area", 2), ("gain", 3), ("error", 3), ("registration_error", 3)):
        assert getattr(moved, name) == pytest.approx(1000.0**power * getattr(found, name), rel=1e-3), name


@pytest.mark.parametrize("sense", [1, -1])
def test_what_nobody_saw_is_in_the_uncertainty(sense):
    """The half of a lens, or of a pit, that lies in the shadow of something."""

    def seen(points):
        return ~((np.abs(points[:, 0] - 0.7) < 0.5) & (np.abs(points[:, 1]) < 1.2))

    half, whole = measured(thickness=sense * THICKNESS, seen=seen), measured(thickness=sense * THICKNESS)
    assert half.error > 2 * whole.error
    assert abs(half.gain - sense * VOLUME) < half.error


@pytest.mark.parametrize("filled_in", [False, True])
def test_of_a_pit_the_rim_hides_what_lies_below_the_line_of_sight(filled_in):
    """A pit of which the far part is seen, over its rim."""
    random = np.random.default_rng(7)
    flat, pit = (random.uniform([-4, -4, 0], [4, 4, 0], (POINTS, 3)) for _ in range(2))
    depth = np.clip((RADIUS - np.linalg.norm(pit[:, :2], axis=1)) / 0.5, 0, 1)
    pit[:, 2] = -depth
    pit = pit[(depth == 0) | (pit[:, 1] > 0.2)]
    for own in (flat, pit):
        own += random.normal(0, NOISE, own.shape)
    clouds = Pair(pit, flat) if filled_in else Pair(flat, pit)
    # The former ground is labelled where the later survey saw through it.
    labelled = flat[(np.linalg.norm(flat[:, :2], axis=1) < RADIUS) & (flat[:, 1] > 0.2)]
    parts = Pair(NOTHING, labelled) if filled_in else Pair(labelled, NOTHING)
    found = SurfaceMap.of(ChangeSurface(parts, clouds, NOTHING, LocalSurface.of(pit), UP), 0.005).volume()
    # Of a truncated cone.
    inner = RADIUS - 0.5
    true = np.pi / 3 * (RADIUS**2 + RADIUS * inner + inner**2) * (1 if filled_in else -1)
    # What was seen is four tenths of it.
    assert abs(found.gain) > 0.6 * abs(true)
    assert abs(found.gain - true) < found.error < 0.5 * abs(true)


@pytest.mark.parametrize("sides", [4, 3])
def test_an_object_above_the_scanners_is_as_high_as_its_sides_where_nobody_saw_its_top(sides):
    """A cabinet of which the sides are seen, all around or but for one."""
    random = np.random.default_rng(11)
    half, height = np.array([0.9, 0.7]), 2.0
    before, around = (random.uniform([-4, -4, 0], [4, 4, 0], (POINTS, 3)) for _ in range(2))
    shadow = [0.0, 0.0, 0.0, 0.4 * (sides == 3)]
    around = around[((around[:, :2] > half) | (around[:, :2] < -half - shadow[2:])).any(axis=1)]
    walls = []
    for axis, sense in ((0, 1), (1, 1), (0, -1), (1, -1))[:sides]:
        wall = random.uniform([*-half, 0], [*half, height], (int(600 * half[1 - axis]), 3))
        wall[:, axis] = sense * half[axis]
        walls.append(wall)
    cabinet = np.concatenate(walls) + random.normal(0, NOISE, (sum(map(len, walls)), 3))
    after = np.concatenate([around, cabinet]) + random.normal(0, NOISE / 2, (len(around) + len(cabinet), 3))
    before = before + random.normal(0, NOISE, before.shape)
    change = ChangeSurface(Pair(NOTHING, cabinet), Pair(before, after), NOTHING, LocalSurface.of(before), UP)
    found = SurfaceMap.of(change, 0.005).volume()
    true = 4 * half.prod() * height
    assert found.gain == pytest.approx(true, rel=0.15)
    assert abs(found.gain - true) < found.error < 0.35 * true


def test_a_part_that_is_not_labelled_is_of_the_change():
    found = measured(limit=0.15)
    assert found.gain == pytest.approx(VOLUME, rel=0.06)


def test_another_change_beside_it_is_not_counted():
    random = np.random.default_rng(3)
    before, _ = ground(random)
    after, lens = ground(random, THICKNESS)
    left = after[:, 0] < 0
    labelled = [after[(lens > 0.05) & own] for own in (left, ~left)]
    gains = []
    for own, other in (labelled, labelled[::-1]):
        change = ChangeSurface(Pair(NOTHING, own), Pair(before, after), other, LocalSurface.of(before), UP)
        gains.append(SurfaceMap.of(change, 0.005).volume().gain)
    assert sum(gains) == pytest.approx(VOLUME, rel=0.08)
    np.testing.assert_allclose(gains, VOLUME / 2, rtol=0.15)


def test_the_floor_below_a_table_is_not_its_surface():
    """What is seen below an overhang: without it, the table would have half its volume."""
    random = np.random.default_rng(4)
    before, _ = ground(random)
    below, _ = ground(random)
    top = np.insert(random.uniform(-1, 1, (600, 2)), 2, 1.0, axis=1)
    after = np.concatenate([below, top])
    change = ChangeSurface(Pair(NOTHING, top), Pair(before, after), NOTHING, LocalSurface.of(before), UP)
    heights = 1.0 - (0.3 * np.sin(top[:, 0]) + 0.2 * np.cos(1.3 * top[:, 1]))
    assert SurfaceMap.of(change, 0.005).volume().gain > 0.8 * 4 * heights.mean()


def test_a_change_of_repeated_points_has_no_volume():
    point = np.repeat(np.array([[0.1, 0.2, 0.3]]), 20, axis=0)
    before, _ = ground(np.random.default_rng(5))
    change = ChangeSurface(Pair(NOTHING, point), Pair(before, point), NOTHING, LocalSurface.of(before), UP)
    assert SurfaceMap.of(change, 0.005) is None


def test_what_differs_beside_it_at_several_levels_is_not_of_the_change():
    """A rack that reaches to the lens, of which the surveys saw its two levels more or less often."""
    random = np.random.default_rng(6)

    def racked(cloud, share):
        high = (
            (cloud[:, 0] > 1.0)
            & (cloud[:, 0] < 3.0)
            & (np.abs(cloud[:, 1]) < 1.5)
            & (random.random(len(cloud)) < share)
        )
        return cloud + 0.15 * high[:, None] * UP

    before, _ = ground(random)
    after, lens = ground(random, THICKNESS)
    clouds = Pair(racked(before, 0.3), racked(after, 0.6))
    labelled = after[(np.abs(lens) > 0.05) & (after[:, 0] < 1.0)]
    change = ChangeSurface(Pair(NOTHING, labelled), clouds, NOTHING, LocalSurface.of(before), UP)
    found = SurfaceMap.of(change, 0.005)
    assert (found.core & ~found.labelled).sum() < 0.15 * found.labelled.sum()


def two_lenses(seed, lost, apart=2.5, *, whole=False):
    """The volumes of one change: a lens that was deposited, and one of another thickness that was dug beside it."""
    random = np.random.default_rng(seed)
    before, _ = ground(random)
    after, _ = ground(random)
    lenses = [
        thickness * np.clip(1 - ((after[:, :2] - [x, 0]) ** 2).sum(axis=1) / RADIUS**2, 0, None)
        for x, thickness in ((-apart / 2, THICKNESS), (apart / 2, -lost))
    ]
    after[:, 2] += sum(lenses)
    labelled = after[np.abs(sum(lenses)) > 0.05]
    change = ChangeSurface(Pair(NOTHING, labelled), Pair(before, after), NOTHING, LocalSurface.of(before), UP)
    return volumes_of(change, 0.005, whole=whole)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("lost", [0.35, 0.15])
def test_what_was_gained_and_what_was_lost_beside_it_are_two_volumes(seed, lost):
    larger, smaller = two_lenses(seed, lost)
    true = sorted((VOLUME, -VOLUME * lost / THICKNESS), key=abs, reverse=True)
    for found, expected in zip((larger, smaller), true, strict=True):
        assert found.gain == pytest.approx(expected, rel=0.08)
        assert found.error < 0.15 * abs(expected)
    (net,) = two_lenses(seed, lost, whole=True)
    assert larger.gain + smaller.gain == pytest.approx(net.gain, abs=net.error)


@pytest.mark.parametrize("thickness", [THICKNESS, -THICKNESS])
def test_what_was_gained_everywhere_is_one_volume(thickness):
    random = np.random.default_rng(5)
    before, _ = ground(random)
    after, lens = ground(random, thickness)
    for limit in (0.05, 0.01):
        labelled = after[np.abs(lens) > limit]
        change = ChangeSurface(Pair(NOTHING, labelled), Pair(before, after), NOTHING, LocalSurface.of(before), UP)
        assert volumes_of(change, 0.005) == (SurfaceMap.of(change, 0.005).volume(),)
