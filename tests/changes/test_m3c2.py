"""M3C2 on planes that moved by a known distance, and against py4dgeo."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax import InputError
from gmmjax.changes import M3C2Settings, m3c2_distances
from gmmjax.pair import Pair

UP = np.array([[0.0, 0.0, 1.0]])
CYLINDER = M3C2Settings(radius=0.1, depth=0.35)
NOISE = 0.01


def plane(count, seed, height=0.0, noise=NOISE):
    random = np.random.default_rng(seed)
    return np.c_[random.uniform(0, 2, (count, 2)), height + noise * random.standard_normal(count)]


def core_points(count=400, seed=9):
    return plane(count, seed, noise=0) * [0.8, 0.8, 1] + [0.2, 0.2, 0]


def risen(step=0.05, **options):
    return Pair(plane(2500, 0, **options), plane(2500, 1, step, **options))


def assert_equal(found, expected, atol=1e-12):
    for field in dataclasses.fields(found):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        for own, its in zip(one, other, strict=True) if isinstance(one, Pair) else [(one, other)]:
            np.testing.assert_allclose(own, its, rtol=1e-6, atol=atol)


def test_a_plane_that_rose_has_its_step_within_the_level_of_detection():
    found = m3c2_distances(core_points(), UP, risen(), CYLINDER)
    within = np.abs(found.distance - 0.05) <= found.level_of_detection
    assert 0.92 <= within.mean() <= 0.98
    # Two means of n points each.
    by_hand = 1.96 * NOISE * np.sqrt(2 / np.median(found.count.before))
    assert np.median(found.level_of_detection) == pytest.approx(by_hand, rel=0.05)
    assert (found.significance > 1.96).all()


def test_an_unchanged_plane_is_significant_in_one_of_twenty_places():
    found = m3c2_distances(core_points(), UP, risen(0.0), CYLINDER)
    assert 0.02 <= (found.significance > 1.96).mean() <= 0.08
    np.testing.assert_array_equal(found.significance > 1.96, np.abs(found.distance) > found.level_of_detection)


def test_a_registration_error_adds_to_the_standard_error():
    core, errors = core_points(), np.linspace(0, 0.02, 400)
    without = m3c2_distances(core, UP, risen(), CYLINDER)
    found = m3c2_distances(core, UP, risen(), CYLINDER, registration_error=errors)
    np.testing.assert_allclose(found.level_of_detection, without.level_of_detection + 1.96 * errors)
    np.testing.assert_array_equal(found.distance, without.distance)
    standard_error = without.level_of_detection / 1.96 + errors
    np.testing.assert_allclose(found.significance, np.abs(found.distance) / standard_error)


def test_figures_of_each_cloud():
    found = m3c2_distances(core_points(), UP, risen(), CYLINDER)
    for spread, count in zip(found.spread, found.count, strict=True):
        assert np.median(spread) == pytest.approx(NOISE, rel=0.1)
        assert np.median(count) == pytest.approx(2500 * np.pi * 0.1**2 / 4, rel=0.1)


def test_where_a_cloud_has_no_or_one_point():
    core = np.array([[0.0, 0, 0], [5, 0, 0], [10, 0, 0]])
    clouds = Pair(np.array([[0, 0, -0.1], [0, 0.01, 0.1], [5, 0, 0.2]]), np.array([[0, 0, 0.2], [5, 0, 0.1]]))
    found = m3c2_distances(core, UP, clouds, CYLINDER)
    np.testing.assert_allclose(found.distance, [0.2, -0.1, np.nan])
    assert np.isnan(found.level_of_detection).all() and np.isnan(found.significance).all()
    np.testing.assert_array_equal(found.count.before, [2, 1, 0])
    nothing = m3c2_distances(core, UP, Pair(clouds.before, np.empty((0, 3))), CYLINDER)
    assert np.isnan(nothing.distance).all() and not nothing.count.after.any()


def test_surfaces_without_noise():
    # A step that sums without rounding.
    clouds = risen(0.25, noise=0.0)
    assert np.isinf(m3c2_distances(core_points(), UP, clouds, CYLINDER).significance).all()
    same = m3c2_distances(core_points(), UP, Pair(clouds.before, clouds.before), CYLINDER)
    assert not same.significance.any() and not same.level_of_detection.any()


def test_each_core_point_may_have_a_cylinder_of_its_own():
    core, clouds = core_points(), risen()
    radius, depth = np.random.default_rng(0).uniform([[0.03], [0.2]], [[0.2], [0.6]], (2, len(core)))
    found = m3c2_distances(core, UP, clouds, M3C2Settings(radius, depth))
    for index in (0, 100, 399):
        one = m3c2_distances(core[index : index + 1], UP, clouds, M3C2Settings(radius[index], depth[index]))
        assert found.level_of_detection[index] == one.level_of_detection[0]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000), shift=st.sampled_from([0.0, 10.0, 5e6]))
def test_a_rigid_motion_changes_nothing(seed, shift):
    random = np.random.default_rng(seed)
    rotation, translation = Rotation.random(random_state=seed).as_matrix(), shift * random.uniform(0.5, 1, 3)
    core, clouds = core_points(50, seed), risen()
    here = m3c2_distances(core, UP, clouds, CYLINDER)
    there = m3c2_distances(
        core @ rotation.T + translation,
        UP @ rotation.T,
        clouds.map(lambda own: own @ rotation.T + translation),
        CYLINDER,
    )
    # Coordinates of 5e6 m are rounded to 1e-9 m, here by the motion.
    assert_equal(there, here, atol=1e-13 + 1e-15 * shift)


def test_survey_coordinates_lose_nothing():
    # What both frames can hold exactly.
    offset, rounded = np.array([4.5e6, 5.4e6, 512.0]), 2.0**-30
    core, clouds = (
        np.round(core_points() / rounded) * rounded,
        risen().map(lambda own: np.round(own / rounded) * rounded),
    )
    here = m3c2_distances(core, UP, clouds, CYLINDER)
    there = m3c2_distances(core + offset, UP, clouds.map(lambda own: own + offset), CYLINDER)
    assert_equal(there, here, atol=1e-15)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000))
def test_swapped_clouds_have_the_opposite_distance(seed):
    core, clouds = core_points(50, seed), risen()
    there = m3c2_distances(core, UP, clouds, CYLINDER)
    back = m3c2_distances(core, UP, clouds.swapped, CYLINDER)
    turned = m3c2_distances(core, -UP, clouds, CYLINDER)
    np.testing.assert_array_equal(there.distance, -back.distance)
    np.testing.assert_array_equal(there.level_of_detection, back.level_of_detection)
    np.testing.assert_allclose(there.distance, -turned.distance, atol=1e-15)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000))
def test_the_order_of_points_and_core_points_does_not_matter(seed):
    random = np.random.default_rng(seed)
    core, clouds = core_points(50, seed), risen()
    order = random.permutation(50)
    there = m3c2_distances(core, UP, clouds, CYLINDER)
    shuffled = m3c2_distances(core[order], UP, clouds.map(random.permutation), CYLINDER)
    np.testing.assert_array_equal(shuffled.count.after, there.count.after[order])
    np.testing.assert_allclose(shuffled.distance, there.distance[order], atol=1e-15)


@pytest.mark.parametrize("depth", [0.1, 0.35, 1.01])
@pytest.mark.parametrize("offset", [0.0, 5e6])
def test_as_py4dgeo(depth, offset, tmp_path, monkeypatch):
    pytest.importorskip("py4dgeo")
    # It logs to a file in the working directory.
    monkeypatch.chdir(tmp_path)
    import py4dgeo

    random = np.random.default_rng(4)
    # Beyond the edge of the clouds, too.
    core = core_points(300) * 1.4 + offset
    normals = UP + 0.3 * random.standard_normal((300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    clouds = risen().map(lambda own: own + offset)
    expected, uncertainty = py4dgeo.M3C2(
        epochs=tuple(map(py4dgeo.Epoch, clouds)),
        corepoints=core,
        corepoint_normals=normals,
        cyl_radius=0.1,
        max_distance=depth,
        registration_error=0.003,
    ).run()
    found = m3c2_distances(core, normals, clouds, M3C2Settings(0.1, depth), 0.003)
    assert np.isnan(expected).any() and np.isfinite(expected).sum() > 100
    np.testing.assert_allclose(found.distance, expected, rtol=0, atol=1e-8 if offset else 1e-14)
    np.testing.assert_allclose(found.level_of_detection, uncertainty["lodetection"], rtol=1e-9)
    for number, spread, count in zip((1, 2), found.spread, found.count, strict=True):
        np.testing.assert_array_equal(count, uncertainty[f"num_samples{number}"])
        # Its standard deviation of no points is 0.
        expected_spread = np.where(count > 0, uncertainty[f"spread{number}"], np.nan)
        np.testing.assert_allclose(spread, expected_spread, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"core_points": [[0, 0, np.nan]]}, r"core_points: 1 of 1 rows have NaN"),
        ({"clouds": Pair([[0.0, 0, 0]], [[0.0, np.inf, 0]])}, r"clouds\.after: 1 of 1 rows"),
        ({"normals": [[0, 0, 0]]}, r"normals: row 0 is 0"),
        ({"normals": np.ones((3, 3))}, r"normals: must be one, or one for each of 1 core points, not 3"),
        ({"settings": M3C2Settings(0.0, 1.0)}, r"radius: must be positive"),
        ({"settings": M3C2Settings(1.0, np.ones(2))}, r"depth: must be one number, or one for each of 1 core points"),
        ({"settings": M3C2Settings(1.0, np.inf)}, r"depth: must be positive and finite"),
        ({"registration_error": -1.0}, r"registration_error: must be 0 or positive"),
    ],
)
def test_what_cannot_be_used_is_named(change, message):
    point = [[0.0, 0, 0]]
    arguments = {"core_points": point, "normals": UP, "clouds": Pair(point, point), "settings": M3C2Settings(1.0, 1.0)}
    with pytest.raises(InputError, match=message):
        m3c2_distances(**(arguments | change))
