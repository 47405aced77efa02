import numpy as np
import pytest

from gmmjax.clouds import PointCloud
from gmmjax.reporting.written_fields import written_fields, written_names

QUARTER_TURN = np.array([[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def scan(**fields):
    colors = np.array([[10, 20, 30], [40, 50, 60]], np.uint8)
    return PointCloud(np.zeros((2, 3)), np.arange(2), colors=colors, fields=fields)


def test_what_was_found_comes_first_and_the_scan_s_own_colours_stay_beside_those_of_the_kinds():
    found = {"label": np.array([-1, 0]), "kind": np.array([0, 1])}
    fields = written_fields(scan(intensity=np.array([7, 8])), found, (), None)
    assert list(fields) == ["label", "kind", "scan_red", "scan_green", "scan_blue", "intensity"]
    np.testing.assert_array_equal(fields["scan_blue"], [30, 60])
    # Where nothing else takes the place of its colours they are written as colours.
    assert list(written_fields(scan(), {"distance": np.zeros(2)}, (), None)) == ["distance"]


@pytest.mark.parametrize("names", [("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z")])
def test_normals_are_turned_with_the_scan_and_other_fields_are_not(names):
    along_x = dict(zip(names, np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]], np.float32), strict=True))
    fields = written_fields(scan(**along_x, height=np.ones(2)), {}, (), QUARTER_TURN)
    np.testing.assert_allclose([fields[name] for name in names], [[0, 0], [1, 1], [0, 0]], atol=1e-7)
    assert all(fields[name].dtype == np.float32 for name in names)
    np.testing.assert_array_equal(fields["height"], 1.0)


def test_a_field_with_the_name_of_what_is_found_is_renamed():
    assert written_names(["label", "row"], {"label"}) == {"label": "input_label", "row": "row"}
    fields = written_fields(scan(row=np.array([3, 4])), {"label": np.zeros(2)}, ("row",), None)
    assert list(fields) == ["label", "input_row"]


def test_names_are_such_as_the_formats_have_and_differ():
    names = written_names(["gps time", "gps_time", "2nd", "x"], set())
    assert len(set(names.values())) == 4
    assert names["2nd"] == "field_2nd" and names["x"] == "input_x"
    assert all(" " not in name for name in names.values())
