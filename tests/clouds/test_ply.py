import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmmjax.clouds import CHANNELS, read_cloud, write_ply
from gmmjax.errors import InputError

FINITE = st.floats(allow_nan=False, allow_infinity=False)
POINTS = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=FINITE)
FIELD_TYPES = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]
TRIANGLE = [[0.0, 0.0, 0.5], [1.0, 0.0, -0.25], [0.0, 1.0, 3.0]]


def header(encoding: str, *lines: str, newline: str = "\n") -> bytes:
    return newline.join(["ply", f"format {encoding} 1.0", *lines, "end_header", ""]).encode()


XYZ = ("property float x", "property float y", "property float z")
LIST = "property list uchar short near"


@pytest.mark.slow
@given(POINTS, st.data())
def test_written_clouds_come_back(tmp_path_factory, points, data):
    count = len(points)
    colors = data.draw(st.none() | hnp.arrays(np.uint8, (count, 3)))
    kinds = data.draw(st.lists(st.sampled_from(FIELD_TYPES), max_size=4))
    fields = {f"field_{i}": data.draw(hnp.arrays(np.dtype(kind), count)) for i, kind in enumerate(kinds)}
    path = tmp_path_factory.mktemp("ply") / "cloud.PLY"
    write_ply(path, points, colors=colors, fields=fields, comments=["end_header of nothing", "élan"])
    cloud = read_cloud(path)
    np.testing.assert_array_equal(cloud.points, points)
    np.testing.assert_array_equal(cloud.colors, colors)
    assert list(cloud.fields) == list(fields)
    for name, values in fields.items():
        np.testing.assert_array_equal(cloud.fields[name], values)
        assert cloud.fields[name].dtype == values.dtype


def test_labels_and_probabilities_have_their_natural_types(tmp_path):
    path = tmp_path / "cloud.ply"
    fields = {
        "label": np.array([-1, 0, 2]),
        "probability": np.float32([0, 0.5, 1]),
        "seen": np.array([True, False, True]),
    }
    write_ply(path, TRIANGLE, fields=fields)
    text = path.read_bytes().split(b"end_header")[0]
    for line in (b"double x", b"double z", b"int label", b"float probability", b"uchar seen"):
        assert b"property " + line + b"\n" in text
    assert read_cloud(path).fields["label"].tolist() == [-1, 0, 2]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": [[0, 0, np.nan]]}, "1 of 1 rows have NaN or inf"),
        ({"points": [[0, 0]]}, r"shape \[N, 3\]"),
        ({"fields": {"label": np.array([2**31])}}, "beyond PLY's int"),
        ({"fields": {"two words": np.zeros(1)}}, "cannot be a PLY property"),
        ({"fields": {"x": np.zeros(1)}}, "cannot be a PLY property"),
        ({"fields": {"label": np.zeros(2)}}, "one for each point"),
        ({"colors": np.zeros((1, 3))}, "uint8"),
        ({"comments": ["first\nelement vertex 9"]}, "line break"),
    ],
)
def test_what_cannot_be_written(tmp_path, arguments, message):
    path = tmp_path / "cloud.ply"
    with pytest.raises(InputError, match=message) as caught:
        write_ply(path, **({"points": [[0, 0, 0]]} | arguments))
    assert str(path) in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_big_endian_mesh_with_elements_before_and_after_the_vertices(write_file):
    content = header(
        "binary_big_endian",
        "comment made by hand",
        "obj_info of no use",
        "element camera 1",
        "property short pan",
        "element vertex 3",
        *("property double x", "property double y", "property double z"),
        *("property uint8 red", "property uint8 green", "property uint8 blue"),
        "property int16 quality",
        "element edge 1",
        "property list uchar int ends",
    )
    content += struct.pack(">h", -7)
    for index, point in enumerate(TRIANGLE):
        content += struct.pack(">3d3Bh", *point, index, 10, 255, -300 + index)
    content += struct.pack(">B2i", 2, 0, 1)
    cloud = read_cloud(write_file("mesh.ply", content))
    np.testing.assert_array_equal(cloud.points, TRIANGLE)
    np.testing.assert_array_equal(cloud.colors, [[0, 10, 255], [1, 10, 255], [2, 10, 255]])
    assert cloud.fields["quality"].tolist() == [-300, -299, -298]
    assert cloud.fields["quality"].dtype == np.int16


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_ascii_mesh_with_any_line_ends(write_file, newline):
    head = header(
        "ascii",
        "element face 1",
        "property list uchar int vertex_indices",
        "element vertex 3",
        *XYZ,
        "property float red",
        "property float green",
        "property float blue",
        "property int label",
        "element edge 0",
        newline=newline,
    )
    rows = ["3 0 1 2", *(f"{x} {y} {z} 0 0.5 1 {label}" for label, (x, y, z) in enumerate(TRIANGLE))]
    cloud = read_cloud(write_file("mesh.ply", head + newline.join(rows).encode()))
    np.testing.assert_array_equal(cloud.points, TRIANGLE)
    np.testing.assert_array_equal(cloud.colors, [[0, 128, 255]] * 3)
    assert cloud.fields["label"].tolist() == [0, 1, 2]
    assert cloud.fields["label"].dtype == np.int32


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("first_byte", [b"\n", b"\r", b" "])
def test_binary_data_that_look_like_a_line_end(write_file, newline, first_byte):
    data = first_byte + b"\x00" * 11
    content = header("binary_little_endian", "element vertex 1", *XYZ, newline=newline) + data
    np.testing.assert_array_equal(read_cloud(write_file("cloud.ply", content)).points, [np.frombuffer(data, "<f4")])


def test_ascii_coordinates_keep_their_digits(write_file):
    content = header("ascii", "element vertex 1", *XYZ) + b"500000.123 4000000.456 0.1\n"
    assert read_cloud(write_file("cloud.ply", content)).points.tolist() == [[500000.123, 4000000.456, 0.1]]


def test_rows_without_a_position_are_dropped_and_counted(write_file):
    content = header("ascii", "element vertex 3", *XYZ, "property int label") + b"nan 0 0 5\n1 2 3 6\n0 inf 0 7\n"
    cloud = read_cloud(write_file("cloud.ply", content))
    assert cloud.points.tolist() == [[1, 2, 3]]
    assert (cloud.rows.tolist(), cloud.rows_dropped, cloud.fields["label"].tolist()) == ([1], 2, [6])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (header("ascii", "element vertex 2", *XYZ) + b"1 2 3\n", "declares 2 vertices, 1 are there"),
        (header("ascii", "element vertex 2", *XYZ) + b"1 2 3\n4 5", "line 9 has 2 values where 3 are expected"),
        (header("ascii", "element vertex 2", *XYZ) + b"1 2 3\n4 5 x\n", "line 9: 'x' is no number"),
        (header("ascii", "element vertex 2", *XYZ) + b"1 2 3 4\n4 5 6 7\n", "line 8 has 4 values"),
        (
            header("ascii", "element vertex 1", *XYZ, "property uchar label") + b"1 2 3 300\n",
            "'label' is declared uint8",
        ),
        (header("binary_little_endian", "element vertex 5", *XYZ) + b"\0" * 30, "declares 5 vertices, 2 are there"),
        (header("binary_little_endian", "element vertex 999999999999", *XYZ) + b"\0" * 30, "2 are there"),
        (
            header("ascii", "element vertex 1", "property float x", "property int label") + b"1 2\n",
            "no y, z, only: x, label",
        ),
        (header("ascii", "element vertex 1", *XYZ, LIST) + b"1 2 3 2 5 6\n", "vertices have lists, .*near.*without"),
        (header("binary_big_endian", "element face 1", LIST, "element vertex 1", *XYZ), "behind some .near., .*first"),
        (header("ascii", "element face 1", "property int x") + b"1\n", "no vertex element, only: face"),
        (header("ascii", "element vertex 1", *XYZ, "property float x") + b"1 2 3 4\n", "more than once"),
        (header("ascii", "element vertex many", *XYZ), "line 3 of the PLY header"),
        (header("ascii", "property float x"), "line 3 of the PLY header"),
        (header("ascii", "element vertex 0", *XYZ), "has 0 points"),
        (b"ply\nelement vertex 0\nend_header\n", "no format line"),
        (b"ply\nformat ascii 1.0\n", "no end_header"),
        (b"solid stl\n", "is no PLY file"),
    ],
)
def test_what_is_wrong_is_said(write_file, content, message):
    path = write_file("cloud.ply", content)
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("channels", [("r", "G", "b"), ("Red", "Green", "Blue"), [f"diffuse_{c}" for c in CHANNELS]])
@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_other_names_of_coordinates_and_colours(write_file, channels, encoding):
    names = [f"property float {axis}" for axis in "XYZ"] + [f"property uchar {channel}" for channel in channels]
    row = b"1 2 3 9 8 7\n" if encoding == "ascii" else struct.pack("<3f3B", 1, 2, 3, 9, 8, 7)
    cloud = read_cloud(write_file("cloud.ply", header(encoding, "element vertex 1", *names) + row))
    assert (cloud.points.tolist(), cloud.colors.tolist(), cloud.fields) == ([[1, 2, 3]], [[9, 8, 7]], {})


def test_usual_names_stay(write_file):
    names = ("property float X", *XYZ, "property uchar r", "property uchar red")
    cloud = read_cloud(write_file("cloud.ply", header("ascii", "element vertex 1", *names) + b"9 1 2 3 4 5\n"))
    assert cloud.points.tolist() == [[1, 2, 3]] and cloud.colors is None
    assert {name: values.tolist() for name, values in cloud.fields.items()} == {"X": [9], "r": [4], "red": [5]}


@pytest.mark.parametrize("encoding", ["binary", "ascii"])
def test_cut_anywhere_is_an_input_error(write_file, tmp_path, encoding):
    path = tmp_path / "whole.ply"
    write_ply(path, np.array(TRIANGLE), fields={"label": np.arange(3)})
    whole = path.read_bytes()
    if encoding == "ascii":
        whole = header("ascii", "element vertex 3", *XYZ) + b"".join(b"%f %f %f\n" % tuple(row) for row in TRIANGLE)
        # The last number, cut, is still a number, and a line end is no duty: such a cut cannot be seen.
        whole = whole.rsplit(b" ", 1)[0] + b" "
    for cut in range(len(whole)):
        with pytest.raises(InputError):
            read_cloud(write_file("cut.ply", whole[:cut]))


def test_equals_open3d(open3d, tmp_path):
    generator = np.random.default_rng(0)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(generator.normal(size=(500, 3))))
    cloud.colors = open3d.utility.Vector3dVector(generator.integers(0, 256, (500, 3)) / 255)
    for ascii_text in (False, True):
        path = tmp_path / f"{ascii_text}.ply"
        open3d.io.write_point_cloud(str(path), cloud, write_ascii=ascii_text)
        theirs, ours = open3d.io.read_point_cloud(str(path)), read_cloud(path)
        np.testing.assert_array_equal(ours.points, np.asarray(theirs.points))
        np.testing.assert_array_equal(ours.colors, np.rint(np.asarray(theirs.colors) * 255))
    write_ply(path, ours.points, colors=ours.colors, fields={"label": np.arange(500)})
    theirs = open3d.io.read_point_cloud(str(path))
    np.testing.assert_array_equal(np.asarray(theirs.points), ours.points)
    np.testing.assert_array_equal(np.rint(np.asarray(theirs.colors) * 255), ours.colors)
