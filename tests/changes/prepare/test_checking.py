import inspect
import linecache
import warnings

import numpy as np
import pytest

from gmmjax import InputError, InputWarning, PointCloud, detect_changes
from gmmjax.changes.prepare.checking import (
    check_comparable,
    check_not_flat,
    check_overlap,
    check_pair,
    check_same_place,
    warn_of_outlines,
)
from gmmjax.changes.registration import Registration
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair

BOX = (-9.0, -9.0, -9.0, 9.0, 9.0, 9.0)
CLOUD = np.random.default_rng(0).normal(size=(300, 3))


@pytest.mark.parametrize(
    ("before", "message"),
    [
        (CLOUD + 1j, "before: must be real numbers, not complex128"),
        (CLOUD > 0, "before: must be real numbers, not bool"),
        (CLOUD.astype(object), "before: must be real numbers, not object"),
        (np.array([[10**400, 1, 2]] * 20), "before: must be real numbers, not object"),
        (np.zeros((20, 3), "M8[s]"), "before: must be real numbers, not datetime64"),
        (1e200 * CLOUD, "before: the points extend over 6.*another unit"),
        (1e-300 * CLOUD, "before: the points extend over 6.*another unit"),
        (CLOUD * [1e300, 1, 1], "before: the points extend over 6.*e.300.*stray points out with crop"),
        (CLOUD * [4e307, 1, 1], "before: the points extend over inf"),
        (np.repeat(np.eye(3), 100, axis=0), "before: its 300 points lie in 3 places only"),
        (np.concatenate([np.zeros((2000, 3)), CLOUD[:2]]), "before: its 2002 points lie in 3 places only"),
    ],
)
def test_what_cannot_be_computed_with_is_refused(before, message):
    with pytest.raises(InputError, match=message):
        check_pair(Pair(before, CLOUD))


def test_a_stray_point_can_be_cropped():
    stray = np.concatenate([CLOUD, [[1e300, 0, 0]]])
    checked, _ = check_pair(Pair(stray, CLOUD), BOX)
    assert checked.cropped == 1 and len(checked.points) == 300


@pytest.mark.parametrize("far", [1e4, 1e6, 3.4028235e38, 1e300])
def test_stray_points_are_left_out_and_counted(far):
    """Whatever follows is that of the cloud without them, and there is no word of millimetres."""
    rows = np.insert(CLOUD, [0, 150, 300], [[far, 0, 0], [np.nan, 0, 0], [0, -far, 0]], axis=0)
    given = PointCloud.from_rows(rows, source="after.las")
    with pytest.warns(InputWarning) as caught:
        (clean, checked), (_, of_file) = (check_pair(Pair(CLOUD, after)) for after in (rows, given))
    texts = [text for text in (str(warning.message) for warning in caught) if "stray" in text]
    assert [text.split(" and ")[0] for text in texts] == [
        f"{label}: 2 stray points lie very far from all others" for label in ("after", "after (after.las)")
    ]
    np.testing.assert_array_equal(checked.points, clean.points)
    np.testing.assert_array_equal(of_file.points, clean.points)
    labels = checked.to_rows(np.zeros(len(checked.points), int), -1)
    assert np.flatnonzero(labels < 0).tolist() == [0, 151, 302]
    counts = {"points": 300, "rows_dropped": 1, "cropped": 0, "stray": 2}
    assert checked.diagnostics(rows) == {"source": None, **counts}
    assert of_file.diagnostics(given) == {"source": "after.las", **counts}


def test_values_return_to_the_rows_of_the_caller():
    rows = np.insert(CLOUD, [0, 7], [[np.nan, 0, 0], [50, 0, 0]], axis=0)
    with pytest.warns(InputWarning, match="1 of 302 rows of the before cloud had no finite position and were left out"):
        checked, other = check_pair(Pair(rows, CLOUD), BOX)
    x = checked.to_rows(checked.points[:, 0], np.nan)
    expected = rows[:, 0].copy()
    expected[[0, 8]] = np.nan
    np.testing.assert_array_equal(x, expected)
    np.testing.assert_array_equal(checked.points, other.points)
    assert checked.diagnostics(PointCloud.from_rows(rows))["cropped"] == 1


def test_clouds_of_other_units_cannot_be_compared():
    scan = np.random.default_rng(1).uniform(size=(2000, 3))
    with pytest.raises(InputError, match=r"before cloud extends over 0\.99.*after cloud over 99.*same unit"):
        check_comparable(Pair(scan, 1000 * scan), Pair(scan, 1000 * scan), 30.0)
    with pytest.raises(InputError, match="nothing can be compared"):
        check_comparable(Pair(scan, scan), Pair(scan[:2], scan), 0.01)
    check_comparable(Pair(scan, scan), Pair(scan, scan), 0.01)


def test_suspicious_extents_are_warned_of():
    with pytest.warns(InputWarning, match=r"differ 200-fold in extent"):
        check_pair(Pair(CLOUD, 200 * CLOUD))


def check_overlap_of(before, after, *registration):
    check_overlap(check_pair(Pair(before, after)), *registration)


def test_disjoint_extents_are_refused():
    with pytest.raises(InputError, match=r"do not overlap \(before .*, after .*\); .*into one frame"):
        check_overlap_of(CLOUD, CLOUD + 100)
    with pytest.raises(InputError, match="do not overlap"):
        check_overlap_of(CLOUD + np.array([0, 100, 0]), CLOUD)
    check_overlap_of(CLOUD, CLOUD + 0.1)


@pytest.mark.parametrize(("applied", "confidence"), [(False, 1.0), (True, 0.5), (False, 0.0)])
def test_a_registration_that_is_missing_or_in_doubt_leaves_the_error(applied, confidence):
    with pytest.raises(InputError, match="do not overlap"):
        check_overlap_of(CLOUD, CLOUD + 100, Registration(np.eye(4), applied=applied, confidence=confidence))


def test_disjoint_extents_that_registration_brings_together_are_none():
    check_overlap_of(CLOUD, CLOUD + 100, Registration(np.eye(4), applied=True))


def test_clouds_of_one_reference_system_that_are_far_apart_are_of_two_places():
    """However alike they look; clouds of no system, or of local ones, may lie anywhere."""
    extent = float(np.ptp(CLOUD, axis=0).max())
    # The widths of the cloud and of the gap, along its longest axis.
    near, far = (CLOUD + (1 + gap) * extent * np.eye(3)[np.ptp(CLOUD, axis=0).argmax()] for gap in (0.9, 1.1))
    systems = Pair("EPSG:25832", "EPSG:25832")
    message = r"do not overlap \(before .*, after .*\), and both files state EPSG:25832; compare scans of one place"
    for pair in (Pair(CLOUD, far), Pair(far, CLOUD)):
        with pytest.raises(InputError, match=message):
            check_same_place(pair, systems)
        with pytest.raises(InputError, match=message):
            check_pair(pair.map(lambda points: PointCloud(points, np.arange(len(points)), crs="EPSG:25832")))
        check_pair(pair)
    check_same_place(Pair(CLOUD, near), systems)
    check_same_place(Pair(CLOUD, far), Pair("EPSG:25832", None))


PLANE = np.c_[np.random.default_rng(2).uniform(-4, 4, (500, 2)), np.zeros(500)]
OTHER = np.c_[np.random.default_rng(3).uniform(-4, 4, (500, 2)), np.zeros(500)]
TURNED = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
BOX_ON_IT = np.concatenate([OTHER, [[0, 0, 0.1], [0, 1, 0.1], [1, 0, 0.1]]])


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (Pair(PLANE, OTHER), "before, after: both scans are flat"),
        (Pair(PLANE @ TURNED, OTHER @ TURNED), "flat"),
        (Pair(*((own @ TURNED).astype(np.float32).astype(float) for own in (PLANE, OTHER))), "flat"),
        (Pair(*((own @ TURNED + [5e5, 5e6, 100]).round(3) for own in (PLANE, OTHER))), "flat"),
        (Pair(1e-6 * PLANE, 1e-6 * OTHER), "flat"),
    ],
)
def test_two_flat_scans_in_one_plane_are_refused(points, message):
    with pytest.raises(InputError, match=message):
        check_not_flat(points, points, registered=False)


@pytest.mark.parametrize(
    "points",
    [
        Pair(PLANE, PLANE.copy()),
        Pair(PLANE, BOX_ON_IT),
        Pair(BOX_ON_IT, PLANE),
        Pair(PLANE, OTHER - [0, 0, 0.01]),
        Pair(PLANE, OTHER @ TURNED),
        Pair(*((own + np.random.default_rng(5).normal(0, 0.002, own.shape)).round(3) for own in (PLANE, OTHER))),
    ],
)
def test_scans_that_are_not_flat_in_one_plane_are_compared(points):
    check_not_flat(points, points, registered=False)


def outline(seed, noise):
    """A square room as a 2-D laser sees it, on a robot that sways."""
    random = np.random.default_rng(seed)
    along, side = random.uniform(0, 10, 4000), np.arange(4000) % 4
    x = np.choose(side, [along, along, np.zeros(4000), np.full(4000, 10.0)])
    y = np.choose(side, [np.zeros(4000), np.full(4000, 10.0), along, along])
    return (np.c_[x, y, np.zeros(4000)] + random.normal(0, noise, (4000, 3))) @ TURNED


@pytest.mark.parametrize("noise", [1e-4, 5e-3])
def test_scans_of_a_2d_laser_that_sways_are_warned_of(noise):
    points = Pair(outline(0, noise), outline(1, noise))
    with pytest.warns(InputWarning, match=r"their points lie in lines, as those of a 2-D laser do.*--method transport"):
        warn_of_outlines(points.map(LocalSurface.of))
    check_not_flat(points, points, registered=False)
    warn_of_outlines(Pair(points.before, points.before).map(LocalSurface.of))


def test_a_floor_is_no_outline():
    random = np.random.default_rng(5)
    floors = Pair(PLANE, OTHER).map(lambda own: LocalSurface.of(own + random.normal(0, 0.002, own.shape)))
    warn_of_outlines(floors)


def test_longitude_and_latitude_without_a_system_are_warned_of():
    random = np.random.default_rng(0)
    scans = Pair(*(random.uniform([11, 48, 400], [11.0003, 48.0002, 403], (500, 3)) for _ in range(2)))
    with pytest.warns(InputWarning, match="may be longitude and latitude in degrees.*project both first"):
        check_pair(scans)
    # A mast in metres is narrow, too, but not as narrow.
    check_pair(scans.map(lambda own: own * [1e3, 1e3, 1]))


@pytest.mark.parametrize("width", [100, 1000, 10_000])
def test_ground_in_degrees_is_warned_of(width):
    random = np.random.default_rng(0)
    metres = random.uniform(0, width, (4000, 2))
    heights = 20 * np.sin(6 * metres[:, 0] / width) + random.normal(0, 0.05, 4000)
    degrees = np.c_[7 + metres[:, 0] / 70_000, 51 + metres[:, 1] / 111_320, heights]
    with pytest.warns(InputWarning, match="longitude and latitude in degrees"):
        check_pair(Pair(degrees, degrees.copy()))
    # The same slopes in lengths, and a facade, over which z is no function of x and y.
    check_pair(Pair(*[np.c_[metres * 10 / width, heights * 10 / width]] * 2))
    facade = np.c_[metres[:, 0] * 10 / width, random.normal(0, 1e-3, 4000), random.uniform(0, 6, 4000)]
    check_pair(Pair(facade, facade))


def test_a_registration_of_two_planes_may_leave_a_slight_tilt():
    tilted = OTHER + OTHER[:, [2, 2, 0]] * [0, 0, 1e-4]
    check_not_flat(Pair(PLANE, tilted), Pair(PLANE, tilted), registered=False)
    with pytest.raises(InputError, match=r"2-D laser.*method='transport'"):
        check_not_flat(Pair(PLANE, tilted), Pair(PLANE, tilted), registered=True)


@pytest.mark.parametrize("method", ["joint", "greedy"])
def test_warnings_point_to_the_line_of_the_caller(method):
    scan = np.random.default_rng(1).uniform(size=(2000, 3))
    # Without the wrapper that checks shapes in tests, which is a caller, too.
    detect = inspect.unwrap(detect_changes)
    with warnings.catch_warnings(record=True) as caught, pytest.raises(InputError, match="same unit"):
        warnings.simplefilter("always")
        detect(scan, 1000 * scan, method=method)  # the line of the caller
    assert [warning.category for warning in caught] == [InputWarning]
    assert caught[0].filename == __file__
    assert "the line of the caller" in linecache.getline(__file__, caught[0].lineno)
