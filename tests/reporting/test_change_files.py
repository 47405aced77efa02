import csv
import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.changes import Box
from gmmjax.reporting.change_files import write_map, write_table

OFFSET = np.array([691_000.0, 5_336_000.0, 500.0])
LENGTHS = st.floats(1e-3, 100.0)


def with_boxes(changes, boxes):
    items = [dataclasses.replace(change, box=box) for change, box in zip(changes.items, boxes, strict=False)]
    return dataclasses.replace(changes, items=tuple(items))


def written_map(changes, folder, crs=None):
    write_map(folder / "a.geojson", changes, crs)
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


def test_the_map_has_the_system_of_the_scans_where_it_is_known(pair, tmp_path):
    content = written_map(pair[2], tmp_path, "EPSG:25832")
    assert content["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::25832"
    assert "crs" not in written_map(pair[2], tmp_path)
    assert [feature["properties"]["kind"] for feature in content["features"]] == ["disappeared", "moved", "appeared"]


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
