"""The map of a floor on which a box came and another one went."""

import dataclasses
import re

import numpy as np
import pytest
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from gmmjax import InputError
from gmmjax.changes import Changes, DetectionConfig
from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from gmmjax.reporting import change_map, write_geotiff
from tests.reporting.conftest import OWN_SYSTEM, change

# UTM: float32 has steps of half a metre there.
OFFSET = np.array([691_000.125, 5_336_000.25, 500.0])
CELL = 0.25


def surveyed(crs=None):
    """A floor of 8 by 6 m; a slab of 1 m² at (1, 1) went, one at (6, 4) came, 0.3 m thick."""
    random = np.random.default_rng(0)
    floor = np.insert(random.uniform(0, [8, 6], (20_000, 2)), 2, 0.0, axis=1)

    def slab(x, y):
        return np.insert(random.uniform([x, y], [x + 1, y + 1], (600, 2)), 2, 0.3, axis=1)

    before, after = np.concatenate([floor, slab(1, 1)]) + OFFSET, np.concatenate([floor, slab(6, 4)]) + OFFSET
    clouds = Pair(before, after).map(PointCloud.from_rows)
    labels = Pair(*(np.repeat([-1, label], [20_000, 600]) for label in (0, 1)))
    distance = Pair(*(np.where(own < 0, 0.0, sign * 0.3) for own, sign in zip(labels, (-1, 1), strict=True)))
    changes = Changes(
        labels_before=labels.before,
        labels_after=labels.after,
        probability_before=(labels.before >= 0) * 0.9,
        probability_after=(labels.after >= 0) * 0.8,
        unobserved_before=np.zeros(20_600, bool),
        unobserved_after=np.zeros(20_600, bool),
        items=(change("disappeared", before[20_000:]), change("appeared", after[20_000:])),
        emd=0.5,
        config=DetectionConfig(),
        diagnostics={},
        crs=crs,
        distance_before=distance.before,
        distance_after=distance.after,
        level_of_detection_before=0.1 * np.abs(distance.before) + 0.01,
        level_of_detection_after=0.1 * np.abs(distance.after) + 0.01,
        unit="m",
        clouds=clouds,
    )
    return changes, clouds


def at(found, band, x, y):
    """The value of a band at a place."""
    row = int(np.floor((found.top - (OFFSET[1] + y)) / found.cell))
    return band[row, int(np.floor((OFFSET[0] + x - found.left) / found.cell))]


def test_each_place_has_its_distance_probability_and_change():
    found = change_map(*surveyed(), CELL)
    places = {(1.5, 1.5): (-0.3, 0.9, 0, 0.04), (6.5, 4.5): (0.3, 0.8, 1, 0.04), (4.1, 3.1): (0.0, 0.0, -1, 0.01)}
    for (x, y), expected in places.items():
        bands = found.distance, found.probability, found.label, found.level_of_detection
        values = [at(found, band, x, y) for band in bands]
        np.testing.assert_allclose(values, expected, atol=1e-6)
    left, right, lower, upper = found.extent
    assert (left / CELL, found.top / CELL) == (round(left / CELL), round(found.top / CELL))
    # Whole cells over all points.
    assert left <= OFFSET[0] < left + CELL and upper - CELL < OFFSET[1] + 6 <= upper
    assert right - left == CELL * found.label.shape[1] and upper - lower == CELL * found.label.shape[0]


def test_a_cell_is_found_from_the_points_and_is_a_round_number():
    found = change_map(*surveyed())
    assert found.cell in (0.05, 0.1, 0.2, 0.5)
    assert np.isfinite(found.distance).mean() > 0.7


def test_places_without_points_have_no_value():
    changes, clouds = surveyed()
    finer = change_map(changes, clouds, 0.01)
    empty = np.isnan(finer.label)
    assert empty.mean() > 0.5
    assert np.isnan(finer.distance[empty]).all() and np.isnan(finer.probability[empty]).all()


def test_a_cell_of_two_changes_is_of_the_one_with_most_points():
    changes, clouds = surveyed()
    fewer = np.where(np.arange(20_600) < 20_300, -1, changes.labels_after)
    found = change_map(dataclasses.replace(changes, labels_after=fewer), clouds, 100.0)
    assert found.label.tolist() == [[0]]
    np.testing.assert_allclose(found.distance, -0.3)


def test_a_geotiff_lies_in_its_place_without_loss(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    found = change_map(*surveyed("EPSG:25832"), CELL)
    write_geotiff(tmp_path / "a map.tif", found)
    with rasterio.open(tmp_path / "a map.tif") as raster:
        assert (raster.count, raster.dtypes[0], raster.crs.to_epsg()) == (4, "float32", 25832)
        assert np.isnan(raster.nodata)
        assert raster.transform.c == found.left and raster.transform.f == found.top
        assert (raster.transform.a, raster.transform.e) == (CELL, -CELL)
        values = next(raster.sample([OFFSET[:2] + np.array([6.5, 4.5])]))
        np.testing.assert_allclose(values, [0.3, 0.8, 1, 0.04], atol=1e-6)
        assert raster.descriptions[0].startswith("distance") and raster.tags()["unit"] == "m"
    # Another reader: the tie point is in double precision.
    with (tmp_path / "a map.tif").open("rb") as file:
        tags = ImageFileDirectory_v2(file.read(8))
        file.seek(tags.next)
        tags.load(file)
        tie_point = tags[33922]
    assert tie_point[3:5] == (found.left, found.top)


def test_a_geotiff_has_a_system_that_has_no_code(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    own = OWN_SYSTEM.replace('"central_meridian",9', '"central_meridian",9.5')
    write_geotiff(tmp_path / "a.tif", change_map(*surveyed(own), CELL))
    with rasterio.open(tmp_path / "a.tif") as raster:
        assert raster.crs == rasterio.crs.CRS.from_wkt(own)
        assert (raster.crs.to_epsg(), raster.crs.to_dict()["lon_0"]) == (None, 9.5)


@pytest.mark.parametrize("crs", ["EPSG:999999", "WGS 84 / UTM zone 32N (north)"])
def test_a_system_that_is_not_known_is_left_out_with_a_warning(tmp_path, crs):
    rasterio = pytest.importorskip("rasterio")
    found = change_map(*surveyed(crs), CELL)
    with pytest.warns(UserWarning, match=f"{re.escape(crs)} is not known"):
        write_geotiff(tmp_path / "a.tif", found)
    with rasterio.open(tmp_path / "a.tif") as raster:
        assert raster.crs is None and raster.transform.c == found.left


def test_what_cannot_be_a_map_is_told(tmp_path):
    changes, clouds = surveyed()
    with pytest.raises(InputError, match="signed distances"):
        change_map(dataclasses.replace(changes, distance_before=None), clouds)
    with pytest.raises(InputError, match="choose a larger one"):
        change_map(changes, clouds, 1e-6)
    with pytest.raises(InputError, match="positive"):
        change_map(changes, clouds, -1.0)
    with pytest.raises(InputError):
        write_geotiff(tmp_path / "missing" / "a.tif", change_map(changes, clouds, CELL))


def test_a_depth_camera_has_no_map_from_above():
    random = np.random.default_rng(0)
    seen = random.uniform([-1, -1, 2], [1, 1, 4], (20_600, 3))
    changes, _ = surveyed()
    clouds = Pair(seen, seen).map(PointCloud.from_rows)
    with pytest.raises(InputError, match="depth camera"):
        change_map(changes, clouds)
