"""Changes of scans of any size, found in tiles."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from gmmjax.changes import NAMES, Clock, DetectionConfig, PointFigures, detect_changes, silent
from gmmjax.clouds import SensorViews, open_cloud, write_ply
from gmmjax.errors import InputError, InputWarning
from gmmjax.pair import Pair
from gmmjax.tiling import TiledDetectionSettings, Workers, tiled_changes
from gmmjax.tiling.coarse_pass import coarse_pass
from tests.clouds.made_clouds import ChunkedArray
from tests.clouds.scanned_room import STATIONS, scan
from tests.tiling.rooms import BOX, of_box, room

# Small blocks, so that a small scene has many.
SETTINGS = TiledDetectionSettings(thinned=55_000, max_points=12_000)
CONFIG = DetectionConfig(restarts=1, max_components=12, registration="never")
PLACE = np.array([433_000.0, 5_411_000.0, 300.0])


@pytest.fixture(scope="module")
def points():
    return Pair(room(0, box=False), room(1, box=True))


def detected(points, folder, **named):
    """The arrays of a record by name, and the record."""
    return detected_in(points.map(ChunkedArray), folder, **named)


def detected_in(clouds, folder, *, threads=1, config=CONFIG, settings=SETTINGS, **named):
    with (
        ThreadPoolExecutor(threads) as executor,
        tiled_changes(
            clouds, config=config, workers=Workers(executor=executor), folder=folder, settings=settings, **named
        ) as found,
    ):
        arrays = {}
        for side, columns in zip(NAMES, found.rows, strict=True):
            for name in ("labels", "probability", "unobserved", *PointFigures._fields):
                arrays[f"{name}_{side}"] = np.array(getattr(found.changes, f"{name}_{side}"))
            np.testing.assert_array_equal(columns.column("kind") > 0, arrays[f"labels_{side}"] >= 0)
        return arrays, found


def views_of(points):
    """A scanner behind the box, of which it sees the near sides only."""
    return points.map(lambda own: SensorViews.from_positions(own, [(5.2, 4.3, 1.5)]))


@pytest.fixture(scope="module")
def found(points, tmp_path_factory):
    return detected(points, tmp_path_factory.mktemp("found"))


@pytest.fixture(scope="module")
def with_views(points, tmp_path_factory):
    return detected(points, tmp_path_factory.mktemp("found"), views=views_of(points))


def assert_same(first, second):
    """Whether two detections are the same, bit for bit."""
    for name, values in first[0].items():
        assert values.tobytes() == second[0][name].tobytes(), name
    assert [change.to_dict() for change in first[1].shown] == [change.to_dict() for change in second[1].shown]


@pytest.mark.slow
def test_the_box_is_one_change_and_nothing_else_is(points, found):
    arrays, record = found
    assert [change.kind for change in record.shown] == ["appeared"]
    box = of_box(points.after)
    assert (arrays["labels_after"][box] == 0).mean() > 0.95
    assert (arrays["labels_after"][~box] == 0).sum() < 0.05 * box.sum()
    assert (arrays["labels_before"] == -1).all()
    # The numbers are those of points, and not of the voxels that they were compared in.
    assert record.shown[0].point_count == (arrays["labels_after"] == 0).sum()
    assert record.shown.diagnostics["after"]["points"] == len(points.after)
    np.testing.assert_allclose(np.sort(record.shown[0].box.extent), np.sort(BOX[1]), atol=0.08)


def test_rows_have_what_a_record_has(points, found):
    arrays, record = found
    for side, own in zip(NAMES, points, strict=True):
        label, probability = arrays[f"labels_{side}"], arrays[f"probability_{side}"]
        assert len(label) == len(own)
        assert ((probability >= 0) & (probability <= 1)).all()
        assert probability[label < 0].max() < 0.5
        distance, limit = arrays[f"distance_{side}"], arrays[f"level_of_detection_{side}"]
        known = np.isfinite(distance)
        assert known[label < 0].mean() > 0.95
        # The floor has not moved.
        assert np.abs(np.median(distance[known])) < 0.001
        assert (np.abs(distance[known & (label < 0)]) > limit[known & (label < 0)]).mean() < 0.1
    assert (arrays["probability_after"][arrays["labels_after"] == 0] > 0.5).all()
    assert len(record.clouds.after) < len(points.after)


@pytest.mark.slow
def test_tiles_and_workers_change_no_bit(points, with_views, tmp_path):
    where = {"threads": 3, "tile_size": 3.0, "views": views_of(points)}
    assert_same(detected(points, tmp_path, **where), with_views)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_regions_with_too_many_voxels_are_coarser(points, found, tmp_path):
    settings = dataclasses.replace(SETTINGS, max_refined=4_000)
    arrays, record = detected(points, tmp_path, settings=settings, tile_size=20.0)
    assert [change.kind for change in record.shown] == ["appeared"]
    box = of_box(points.after)
    assert (arrays["labels_after"][box] == 0).mean() > 0.85
    sizes = record.clouds.map(lambda own: len(own.points))
    assert max(sizes) < min(found[1].clouds.map(lambda own: len(own.points)))


def test_nothing_is_found_where_nothing_changed(tmp_path):
    arrays, record = detected(Pair(room(0, box=False), room(2, box=False)), tmp_path)
    assert len(record.changes) == 0
    assert all((arrays[f"labels_{side}"] == -1).all() for side in ("before", "after"))
    assert np.isfinite(arrays["distance_after"]).mean() > 0.95


@pytest.mark.slow
def test_a_scan_is_like_itself(points, tmp_path):
    arrays, record = detected(Pair(points.before, points.before.copy()), tmp_path)
    assert len(record.changes) == 0
    assert np.nanmax(np.abs(arrays["distance_after"])) == 0


@pytest.mark.slow
def test_stray_points_change_no_bit(points, found, tmp_path):
    far = np.array([[1e6, 0, 0], [0, -3.4028235e38, 0]])
    with pytest.warns(InputWarning, match="after: 2 stray points"):
        arrays, record = detected(Pair(points.before, np.concatenate([far, points.after])), tmp_path)
    kept = {name: values[2:] if name.endswith("after") else values for name, values in arrays.items()}
    assert_same((kept, record), found)
    assert (arrays["labels_after"][:2] == -1).all()
    diagnostics = record.changes.diagnostics
    assert (diagnostics["before"]["stray"], diagnostics["after"]["stray"]) == (0, 2)
    assert diagnostics["after"]["points"] == len(points.after)


@pytest.mark.parametrize("far", [np.array([[300.0, 300.0, 5.0]]), np.full((3_000, 3), -9999.0)])
def test_the_coarse_pass_leaves_stray_points_out(points, far):
    def thinned(after):
        clouds = Pair(points.before, after).map(lambda own: ChunkedArray(own[::4]))
        return coarse_pass(clouds, Pair(None, None), CONFIG, Clock(silent), SETTINGS)

    expected = thinned(points.after)
    with pytest.warns(InputWarning, match=rf"after: {len(far[::4]):,} stray point"):
        coarse = thinned(np.concatenate([points.after, np.resize(far, (4 * -(-len(far) // 4), 3))]))
    assert tuple(coarse.stray) == (0, len(far[::4]))
    np.testing.assert_array_equal(coarse.thinned.after.points, expected.thinned.after.points)


@pytest.mark.slow
def test_survey_coordinates_and_rows_that_are_not_compared_lose_nothing(points, found, tmp_path):
    after = np.insert(points.after, [0, 7], [[np.nan] * 3, [50.0, 50.0, 50.0]], axis=0)
    for side, own in zip(NAMES, (points.before, after), strict=True):
        np.save(tmp_path / f"{side}.npy", own + PLACE)
    crop = (*(PLACE - 1.0).tolist(), *(PLACE + np.array([9.0, 7.0, 3.0])).tolist())
    clouds = NAMES.map(lambda side: open_cloud(tmp_path / f"{side}.npy"))
    arrays, record = detected_in(clouds, tmp_path, config=dataclasses.replace(CONFIG, crop=crop))
    assert len(record.shown) == 1
    np.testing.assert_allclose(record.shown[0].mean, found[1].shown[0].mean + PLACE, atol=0.01)
    # As `np.insert` counts: the first row, and the ninth.
    assert (arrays["labels_after"][[0, 8]] == -1).all() and np.isnan(arrays["distance_after"][[0, 8]]).all()
    for side, gone in (("before", []), ("after", [0, 8])):
        labels, distance = (np.delete(arrays[f"{name}_{side}"], gone) for name in ("labels", "distance"))
        assert (labels == found[0][f"labels_{side}"]).mean() > 0.999
        same = np.isfinite(distance) & np.isfinite(near := found[0][f"distance_{side}"])
        assert np.isclose(distance[same], near[same], atol=1e-4).mean() > 0.99


@pytest.mark.slow
def test_what_is_shown_has_the_colours_of_its_rows(points, found, tmp_path):
    """In reports of large scans as of small ones."""
    colors = points.map(lambda own: np.random.default_rng(0).integers(0, 256, (len(own), 3)).astype(np.uint8))
    intensity = np.arange(len(points.after), dtype=np.uint16)
    write_ply(tmp_path / "before.ply", points.before, colors=colors.before)
    write_ply(tmp_path / "after.ply", points.after, fields={"intensity": intensity})
    clouds = NAMES.map(lambda side: open_cloud(tmp_path / f"{side}.ply"))
    arrays, record = detected_in(clouds, tmp_path)
    assert_same((arrays, record), found)
    shown = record.clouds
    np.testing.assert_array_equal(shown.before.colors, colors.before[shown.before.rows])
    np.testing.assert_array_equal(shown.after.fields["intensity"], intensity[shown.after.rows])
    coarse = record.shown.diagnostics["voxel_size"]
    for own, cloud in zip(points, shown, strict=True):
        apart = np.linalg.norm(own[cloud.rows] - cloud.points, axis=1)
        assert apart.max() < 2 * coarse and np.median(apart) < coarse
    changed = record.shown.labels_after == 0
    assert (arrays["labels_after"][shown.after.rows[changed]] == 0).all()


@pytest.mark.slow
def test_views_tell_what_was_not_observed(with_views):
    arrays, record = with_views
    assert [change.kind for change in record.shown] == ["appeared"]
    assert arrays["unobserved_before"].any()
    assert np.isnan(arrays["distance_before"][arrays["unobserved_before"]]).all()


@pytest.mark.slow
def test_stations_are_recognised_by_the_density_of_all_points():
    """Which their voxels, those of the coarse pass, do not have."""
    clouds = Pair(1, 2).map(lambda seed: ChunkedArray(scan(STATIONS[0], 150_000, seed=seed), 50_000))
    for switched_on in (True, False):
        config = dataclasses.replace(CONFIG, recognise_stations=switched_on)
        coarse = coarse_pass(clouds, Pair(None, None), config, Clock(silent), SETTINGS)
        assert max(len(own.points) for own in coarse.thinned) < 60_000
        for own, survey in zip(coarse.prepared.scans, coarse.prepared.surveys, strict=True):
            assert own.recognised == switched_on == (survey.views is not None)
            if switched_on:
                np.testing.assert_allclose(survey.views.poses[:, :3, 3], STATIONS[:1], atol=0.4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "named", "message"),
    [
        ({"method": "greedy"}, {}, "method=greedy: only 'joint'"),
        ({"voxel_size": 0.1}, {}, "voxel_size: in tiles"),
        ({}, {"tile_size": 0.01}, "below 10 point spacings"),
        ({}, {"tile_size": -1.0}, "must be positive"),
        ({"crop": (90.0, 90.0, 90.0, 99.0, 99.0, 99.0)}, {}, "before: has no points inside the crop box"),
    ],
)
def test_what_cannot_be_used_is_named(points, tmp_path, change, named, message):
    with pytest.raises(InputError, match=message):
        detected(points, tmp_path, config=DetectionConfig(**{**CONFIG.to_dict(), **change}), **named)
    assert list(tmp_path.iterdir()) == []


def test_scans_that_do_not_overlap_are_refused(points, tmp_path):
    with pytest.raises(InputError, match=r"before, after: the scans do not overlap \(before .*into one frame"):
        detected(Pair(points.before, points.after + np.array([5_000.0, 0.0, 0.0])), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_scans_of_two_places_of_one_reference_system_are_refused(points, tmp_path):
    apart = Pair(points.before, points.before + np.array([100.0, 0.0, 0.0]))
    for side, own in zip(NAMES, apart, strict=True):
        np.save(tmp_path / f"{side}.npy", own)
    files = NAMES.map(lambda side: open_cloud(tmp_path / f"{side}.npy"))
    with pytest.raises(InputError, match=r"the scans do not overlap .* both files state EPSG:25832"):
        detected_in(files.map(lambda own: dataclasses.replace(own, crs="EPSG:25832")), tmp_path)


def test_volumes_are_refused(tmp_path):
    random = np.random.default_rng(0)
    with pytest.raises(InputError, match="fill volumes"):
        detected(Pair(*random.normal(size=(2, 5_000, 3))), tmp_path)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:1 of 15,663 rows of the after cloud had no finite position")
def test_few_points_are_compared_as_in_memory(tmp_path):
    few = Pair(room(0, box=False)[::4], np.insert(room(1, box=True)[::4], 3, np.nan, axis=0))
    for side, own in zip(NAMES, few, strict=True):
        np.save(tmp_path / f"{side}.npy", own)
    clouds = NAMES.map(lambda side: open_cloud(tmp_path / f"{side}.npy"))
    arrays, record = detected_in(clouds, tmp_path)
    expected = detect_changes(few.before, few.after, config=CONFIG)
    assert [change.to_dict() for change in record.shown] == [change.to_dict() for change in expected]
    for name, values in arrays.items():
        np.testing.assert_allclose(values, getattr(expected, name), rtol=1e-6)
    assert record.shown.diagnostics["after"]["source"] == str(tmp_path / "after.npy")
