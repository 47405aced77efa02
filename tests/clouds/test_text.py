import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmmjax.clouds import read_cloud
from gmmjax.errors import InputError

FINITE = st.floats(allow_nan=False, allow_infinity=False)
ROWS = hnp.arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=FINITE)


@given(
    ROWS, st.sampled_from([" ", ",", ", ", "\t", "   ", ";", "; ", ";\t", " , "]), st.sampled_from(["\n", "\r\n", "\r"])
)
def test_numbers_come_back(write_file, rows, separator, newline):
    text = newline.join(separator.join(map(repr, row)) for row in rows.tolist())
    np.testing.assert_array_equal(read_cloud(write_file("cloud.txt", text.encode())).points, rows)


@pytest.mark.parametrize("name", ["a.xyz", "a.txt", "a.csv", "a.CSV"])
def test_comments_and_blank_lines(write_file, name):
    text = b"\xef\xbb\xbf# made by hand\n\n1 2 3\n  // half\n   \n4 5 6\n\n"
    assert read_cloud(write_file(name, text)).points.tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize(
    ("line", "colors", "intensity"),
    [
        ("1 2 3", None, None),
        ("1 2 3 0.5", None, 0.5),
        ("1 2 3 10 20 255", [10, 20, 255], None),
        ("1 2 3 -7 10 20 255", [10, 20, 255], -7),
    ],
)
def test_layouts(write_file, line, colors, intensity):
    for name, text in (("a.xyz", line), ("a.pts", f"1\n{line}\n"), ("a.csv", line.replace(" ", ","))):
        cloud = read_cloud(write_file(name, text.encode()))
        assert cloud.points.tolist() == [[1, 2, 3]]
        assert (None if cloud.colors is None else cloud.colors[0].tolist()) == colors
        assert {key: values.tolist() for key, values in cloud.fields.items()} == (
            {} if intensity is None else {"intensity": [intensity]}
        )


def test_header_line_names_the_columns(write_file):
    text = b'"label",Z,Y,X,R,G,B,Intensity\n7,3,2,1,0,0.2,1,9\n'
    cloud = read_cloud(write_file("a.csv", text))
    assert cloud.points.tolist() == [[1, 2, 3]]
    assert cloud.colors.tolist() == [[0, 51, 255]]
    assert {name: values.tolist() for name, values in cloud.fields.items()} == {"label": [7], "intensity": [9]}


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.asc", "1,5;2,25;3,0\n", "line 1 has commas beside other separators: numbers with a decimal comma"),
        ("a.asc", "# x;y;z\n1.5;2.25;3\n1,5;2;3\n", "line 3 has commas beside"),
        ("a.txt", "x y z\n1,5 2,25 3,0\n", "line 2 has commas beside"),
        ("a.txt", "1\t2\t3\r1\t2,5\t3\r", "line 2 has commas beside"),
        ("a.xyz", "1 2 3,5\n", "line 1 has commas beside"),
        ("a.csv", "1;;3\n", "line 1 has an empty cell"),
        ("a.asc", "ncols 4\nnrows 3\nxllcorner 0\n1 2 3 4\n", "is a raster"),
        ("a.xyz", "1 2 3\n# remark\n\n4 five 6\n", "line 4: 'five' is no number"),
        ("a.xyz", "1 2 3\r\n4 5 6\r\n7 8\r\n", "line 3 has 2 values where 3 are expected"),
        ("a.xyz", "1 2 3\n4 5 6 7\n", "line 2 has 4 values where 3 are expected"),
        ("a.csv", "1,2,3\n4,,6\n", "line 2 has an empty cell"),
        ("a.csv", "x,y,height\n1,2,3\n", "has no z, only: x, y, height"),
        ("a.csv", "x,y,z,z\n1,2,3,4\n", "'z'.* more than once"),
        ("a.csv", "x,y,z\n1,2,3,4\n", "line 2 has 4 values where 3"),
        ("a.txt", "1 2 3 4 5\n", "line 1 has 5 values; without a header line"),
        ("a.xyz", "# nothing\n", "has 0 points"),
        ("a.xyz", "x y z\n", "has 0 points"),
        ("a.pts", "3\n1 2 3\n4 5 6\n", "declares 3 points in its first line, 2 are there"),
        ("a.pts", "1\n1 2 3\n4 5 6\n", "declares 1 points in its first line, 2 are there"),
        ("a.pts", "1 2 3\n4 5 6\n", "line 1 of a .pts file must be the number of points, not '1 2 3'"),
        ("a.xyz", "1 2 3_0\n", "'3_0' is no number"),
        ("a.xyz", "1 2 3\n\x001 2 3\n", "line 2"),
    ],
)
def test_what_is_wrong_is_said(write_file, name, text, message):
    path = write_file(name, text.encode())
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(path)
    assert str(caught.value).startswith(str(path))


def test_rows_of_nan_are_dropped(write_file):
    cloud = read_cloud(write_file("a.xyz", b"nan nan nan\n1 2 3\ninf 0 0\n"))
    assert (cloud.points.tolist(), cloud.rows.tolist(), cloud.rows_dropped) == ([[1, 2, 3]], [1], 2)


@pytest.mark.parametrize(
    "text",
    [
        "//X;Y;Z\n1;2;3;\n4;5;6;\n",
        "x; y; z\n1; 2; 3\n4; 5; 6\n",
        "// one, two; three, four five\n1 2 3\n4 5 6\n",
        "1, 2, 3\n4,5 ,6\n",
        "# a remark; another\n1,2,3\n4,5,6\n",
        "1.0,2.0,3.0 \n 4,5,6\n",
        "x\ty\tz\n1\t2\t3\n4\t5\t6\n",
    ],
)
def test_separators_that_are_clear(write_file, text):
    assert read_cloud(write_file("a.asc", text.encode())).points.tolist() == [[1, 2, 3], [4, 5, 6]]


@given(ROWS, st.sampled_from([";", "; ", " ", "\t"]))
def test_decimal_commas_are_never_taken_for_separators(write_file, rows, separator):
    text = "\n".join(separator.join(repr(value).replace(".", ",") for value in row) for row in rows.tolist())
    if "," not in text:
        return
    with pytest.raises(InputError, match="decimal comma"):
        read_cloud(write_file("a.asc", text.encode()))
