import csv
import dataclasses
import json
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.changes import Box
from gmmjax.errors import InputWarning
from gmmjax.reporting.change_files import write_map, write_table
from tests.reporting.conftest import OWN_SYSTEM

OFFSET = np.array([691_000.0, 5_336_000.0, 500.0])
LENGTHS = st.floats(1e-3, 100.0)


def with_boxes(changes, boxes):
    items = [dataclasses.replace(change, box=box) for change, box in zip(changes.items, boxes, strict=False)]
    return dataclasses.replace(changes, items=tuple(items))


def written_map(changes, folder):
    write_map(folder / "a.geojson", changes)
    return json.loads((folder / "a.geojson").read_text())


def area(ring):
    (x, y), (u, v) = np.array(ring[:-1]).T, np.array(ring[1:]).T
    return float((x * v - u * y).sum() / 2)


def test_the_table_has_a_row_for_each_change(pair, tmp_path):
    changes = dataclasses.replace(pair[2], unit="m")
    write_table(tmp_path / "a.csv", changes)
    with (tmp_path / "a.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["kind"] for row in rows] == ["disappeared", "moved", "appeared"]
    assert float(rows[0]["centre_x"]) == changes[0].box.centre[0]
    assert (rows[0]["change"], rows[0]["partner"], rows[0]["volume"], rows[0]["unit"]) == ("0", "", "", "m")


def test_a_table_without_changes_has_its_heading(pair, tmp_path):
    write_table(tmp_path / "a.csv", dataclasses.replace(pair[2], items=()))
    assert (tmp_path / "a.csv").read_text().startswith("change,kind,probability")


def surveyed(changes, crs, place=(500_000.0, 5_000_000.0, 500.0)):
    """The changes at a place of a reference system, 30 by 20 m."""
    boxes = [Box(np.array(place), np.array([30.0, 20.0, 1.0]), np.eye(3))] * len(changes)
    return dataclasses.replace(with_boxes(changes, boxes), crs=crs)


@pytest.mark.parametrize("crs", ["EPSG:32632", OWN_SYSTEM])
def test_the_map_is_in_longitude_and_latitude(pair, tmp_path, crs):
    pytest.importorskip("rasterio")
    content = written_map(surveyed(pair[2], crs), tmp_path)
    assert "crs" not in content and content["crs_of_scans"] == crs
    ring = np.array(content["features"][0]["geometry"]["coordinates"][0])
    # The central meridian, whose scale is 0.9996; a degree of latitude is 111.1 km there.
    np.testing.assert_allclose(ring.mean(axis=0)[0], 9, atol=1e-4)
    np.testing.assert_allclose(
        np.ptp(ring, axis=0) * [111_320 * np.cos(np.radians(45.15)), 111_130], [30, 20], rtol=2e-3
    )
    assert area(ring) > 0
    assert content["features"][0]["properties"]["centre_x"] == 500_000


def test_axes_that_point_south_and_west(pair, tmp_path):
    """Krovak, of the Czech Republic: outlines stay counterclockwise."""
    pytest.importorskip("rasterio")
    content = written_map(surveyed(pair[2], "EPSG:5513", (1_040_000.0, 740_000.0, 200.0)), tmp_path)
    ring = np.array(content["features"][0]["geometry"]["coordinates"][0])
    assert area(ring) > 0
    np.testing.assert_allclose(ring.mean(axis=0), [14.4, 50.1], atol=0.2)


@pytest.mark.parametrize(
    ("crs", "name"),
    [
        ("EPSG:25832", "urn:ogc:def:crs:EPSG::25832"),
        (OWN_SYSTEM, OWN_SYSTEM),
        ("a system of GeoTIFF parameters", "LOCAL_CS"),
    ],
)
def test_without_rasterio_the_map_says_what_it_is_in(pair, tmp_path, monkeypatch, crs, name):
    monkeypatch.setitem(sys.modules, "rasterio.warp", None)
    changes = surveyed(pair[2], crs)
    with pytest.warns(InputWarning, match=r"a\.geojson is in .*, not in degrees.*gmmjax\[map\]"):
        content = written_map(changes, tmp_path)
    assert content["crs"]["properties"]["name"].startswith(name)
    np.testing.assert_array_equal(
        np.min(content["features"][0]["geometry"]["coordinates"][0], axis=0), [499_985, 4_999_990]
    )


@pytest.mark.parametrize("crs", ["EPSG:4978", "EPSG:999999", "a name"])
def test_what_is_no_map_projection_is_not_converted(pair, tmp_path, crs):
    pytest.importorskip("rasterio")
    with pytest.warns(InputWarning, match=f"in {crs}, not in degrees"):
        assert "crs" in written_map(surveyed(pair[2], crs), tmp_path)


def test_coordinates_of_no_system_are_not_taken_for_degrees(pair, tmp_path):
    content = written_map(pair[2], tmp_path)
    assert content["crs_of_scans"] is None
    assert content["crs"]["properties"]["name"].startswith("LOCAL_CS")
    assert [feature["properties"]["kind"] for feature in content["features"]] == ["disappeared", "moved", "appeared"]


def test_a_map_without_changes(pair, tmp_path):
    content = written_map(dataclasses.replace(pair[2], items=(), crs="EPSG:25832"), tmp_path)
    assert content["features"] == []


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("maps")


@given(st.tuples(LENGTHS, LENGTHS, LENGTHS), st.integers(0, 10**6), st.booleans())
def test_outlines_hold_their_box_and_are_counterclockwise(pair, folder, lengths, seed, upright):
    rotation = Rotation.random(rng=seed)
    if upright:
        rotation = Rotation.from_euler("z", seed / 7)
    box = Box(OFFSET, np.array(lengths), rotation.as_matrix())
    feature = written_map(with_boxes(pair[2], [box]), folder)["features"][0]
    (ring,) = feature["geometry"]["coordinates"]
    assert ring[0] == ring[-1] and area(np.array(ring) - OFFSET[:2]) > 0
    corners = box.corners()
    edges = np.diff(ring, axis=0)
    for start, edge in zip(ring, edges, strict=False):
        outside = edge[0] * (corners[:, 1] - start[1]) - edge[1] * (corners[:, 0] - start[0])
        assert (outside > -1e-6 * max(lengths) ** 2).all()
    assert feature["properties"]["base"] == corners[:, 2].min()
    assert feature["properties"]["top"] == corners[:, 2].max()


@pytest.mark.parametrize(
    ("extent", "kind"),
    [((2.0, 1.0, 0.5), "Polygon"), ((2.0, 0.0, 1.0), "LineString"), ((0.0, 0.0, 1.0), "Point"), ((0, 0, 0), "Point")],
)
def test_boxes_without_a_width(pair, tmp_path, extent, kind):
    box = Box(OFFSET, np.array(extent, float), np.eye(3))
    assert written_map(with_boxes(pair[2], [box]), tmp_path)["features"][0]["geometry"]["type"] == kind
