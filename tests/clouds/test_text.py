import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmmjax.clouds import read_cloud
from gmmjax.errors import InputError, InputWarning

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
        ("a.asc", "1,500;2,250;3,000\n", "'1,500', whose comma may be a decimal one or one of thousands"),
        ("a.asc", "# x;y;z\n1.5;2.25;3\n1,5;2;3\n", "line 3: '1,5' is no number, nor are decimal commas"),
        ("a.asc", "1.234,5;2;3\n", "line 1: '1.234,5' is no number"),
        ("a.txt", "x y z\n1,5 2,25 3,0\n", "line 2 has commas beside other separators"),
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
        ("a.pts", "3\n1 2 3\n4 5 6\n", "declares 3 points in line 1, 2 are there"),
        ("a.pts", "1\n1 2 3\n4 5 6\n", "declares 1 points in line 1, 2 are there"),
        ("a.asc", "//X Y Z\n3\n1 2 3\n4 5 6\n", "declares 3 points in line 2, 2 are there"),
        ("a.pts", "1\n1 2 3\n2\n4 5 6\n", "declares 2 points in block 2, 1 are there"),
        ("a.pts", "2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n", "as a PTX file"),
        ("a.ptx", "2\n1\n0 0 0\n", "is of PTX, scans with their poses"),
        ("a.asc", "//X Y Z M3C2 distance\n1 2 3 0.5\n", "line 1 names columns .*, not one for each of the 4 values"),
        ("a.asc", "# x y z\n1 2 3 4 5 6\n", "line 1 names columns .*, not one for each of the 6 values"),
        ("a.asc", "# z y x in metres\n1 2 3\n", "line 1 names columns"),
        ("a.asc", "# E N H I\n1 2 3 4\n", "line 1 seems to name the columns .*E, N, H, I.* none of them x, y and z"),
        ("a.csv", "0,1.5,2.5,3\n1,1.5,2.5,3\n2,1.5,2.5,3\n", "the first of 4 columns has whole numbers"),
        ("a.xyz", "2 363500.25 6671234.5 45.5\n2 3.5 4.5 5\n", "the first of 4 columns has whole numbers"),
        ("a.csv", "X,Y,Z,x\n1,2,3,4\n", "'x'.* more than once"),
        ("a.csv", "x,y,z\nm,m,m\n1,2,3\n", "line 2: 'm' is no number"),
        ("a.csv", "x,y,z\n1,2,3\nx,y,z\n1,2,3\n", "line 3: 'x' is no number"),
        ("a.csv", "x,y,z,red,green,blue\n1,2,3,4,5,dark\n", "line 2: 'dark' is no number"),
        ("a.csv", '"x" "y" "z"\n"1" 1 2 3\n', "line 2 has 4 values where 3"),
        ("a.csv", "1,2,3,\n4,5,6\n", "line 2 has 3 values where 4"),
        ("a.csv", 'x,y,z,name\n1,2,3,"wall\n4,5,6,box\n', "a quote is not closed"),
        ("a.xyz", "1 2 3 wall\n", "'wall' is no number.* name the columns in a first line"),
        ("a.txt", "x\0y\0z\0", "is no text in UTF-8, nor in UTF-16"),
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
    """They are read where nothing else can be meant, and refused otherwise."""
    text = "\n".join(separator.join(repr(value).replace(".", ",") for value in row) for row in rows.tolist())
    if "," not in text:
        return
    file = write_file("a.asc", text.encode())
    if separator == " ":
        with pytest.raises(InputError, match="decimal comma"):
            read_cloud(file)
        return
    try:
        found = read_cloud(file).points
    except InputError as error:
        assert "one of thousands" in str(error)
    else:
        np.testing.assert_array_equal(found, rows)


NAMED = [
    # CloudCompare.
    ("//X Y Z R G B Intensity", " ", {"intensity": 4.0}, True),
    ("//X,Y,Z,R,G,B,Intensity", ",", {"intensity": 4.0}, True),
    ("//X;Y;Z;R;G;B;Intensity", ";", {"intensity": 4.0}, True),
    ("//X Y Z Rf Gf Bf Intensity", " ", {"intensity": 4.0}, True),
    ("//X Y Z Nx Ny Nz Label", " ", {"Nx": 1.0, "Ny": 2.0, "Nz": 3.0, "Label": 4.0}, False),
    ("//X,Y,Z,Intensity,Nx,M3C2 distance,C2C distances[<2]", ",", None, False),
    # Comments of other programs, above other comments, and with a word before the names.
    ("# x y z normal_x normal_y normal_z curvature", " ", None, False),
    ("#x,y,z,a,b,c,d\n# made on Monday", ",", dict(zip("abcd", (1.0, 2.0, 3.0, 4.0), strict=True)), False),
    ("# columns: x, y, z, a, b, c, Scan angle", ",", {"a": 1.0, "b": 2.0, "c": 3.0, "Scan angle": 4.0}, False),
    ("# FIELDS x y z a b c d", " ", dict(zip("abcd", (1.0, 2.0, 3.0, 4.0), strict=True)), False),
    ("; X Y Z red green blue i", "\t", {"i": 4.0}, True),
    # Lines of words.
    ('"X","Y","Z","distance uncertainty","M3C2 distance","c","d"', ",", None, False),
    ("X\tY\tZ\tScan angle\ta\tb\tc", "\t", None, False),
    ('"X" "Y" "Z" "Scan angle" a b c', " ", None, False),
    ("Survey of a hall\nx y z diffuse_red diffuse_green diffuse_blue i", " ", {"i": 4.0}, True),
    ("X (m), Y (m), Z (m), Red, Green, Blue, I", ",", {"I": 4.0}, True),
    ("sep=;\nx;y;z;r;g;b;i", ";", {"i": 4.0}, True),
    ("x,y,z,r,b,c,d", ",", {"r": 1.0, "b": 2.0, "c": 3.0, "d": 4.0}, False),
]


@pytest.mark.parametrize(("head", "separator", "fields", "colored"), NAMED)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_columns_are_those_that_a_line_above_them_names(write_file, head, separator, fields, colored, encoding):
    rows = "\r\n".join(separator.join(map(str, row)) for row in ([7, 8, 9, 1, 2, 3, 4], [70, 80, 90, 1, 2, 3, 4]))
    cloud = read_cloud(write_file("a.txt", f"{head}\r\n{rows}\r\n".encode(encoding)))
    assert cloud.points.tolist() == [[7, 8, 9], [70, 80, 90]]
    assert (cloud.colors is not None) == colored and (not colored or cloud.colors[0].tolist() == [1, 2, 3])
    found = {name: values[0] for name, values in cloud.fields.items()}
    assert found == fields if fields else list(found.values()) == [1, 2, 3, 4]


def test_names_in_another_order(write_file):
    for head in ("# z y x", "// Z, Y, X", "z y x"):
        assert read_cloud(write_file("a.xyz", f"{head}\n3 2 1\n".encode())).points.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize(("head", "row"), [(",x,y,z", "5,1,2,3"), (";x;y;z", "5;1;2;3"), ("\tx\ty\tz", "5\t1\t2\t3")])
def test_the_index_of_a_data_frame(write_file, head, row):
    cloud = read_cloud(write_file("a.csv", f"{head}\n{row}\n".encode()))
    assert cloud.points.tolist() == [[1, 2, 3]] and cloud.fields["column_1"].tolist() == [5]


@pytest.mark.parametrize(
    ("head", "row", "text"),
    [
        ("time,x,y,z,i", "2024-05-01 12:00:00,1,2,3,4", "'time' has text .line 2: '2024-05-01 12:00:00'"),
        ("time,x,y,z,i", "20240501 120000,1,2,3,4", "'time' has text"),
        ("x;y;z;i;name", '1;2;3;4;"Smith, J."', "'name' has text .line 2: 'Smith, J.'"),
        ("x,y,z,i,name", "1,2,3,4,M\xfcller", "'name' has text"),
        ("date time x y z i", "2024-05-01 12:00:00 1 2 3 4", "'date' has text|'time' has text"),
    ],
)
def test_columns_of_text_are_left_out_with_a_word(write_file, head, row, text):
    with pytest.warns(InputWarning, match=text):
        cloud = read_cloud(write_file("a.csv", f"{head}\n{row}\n".encode("latin-1")))
    assert cloud.points.tolist() == [[1, 2, 3]] and {k: v.tolist() for k, v in cloud.fields.items()} == {"i": [4]}


@pytest.mark.parametrize(
    ("text", "points"),
    [
        ('"x","y","z"\n"1","2","3"\n', [[1, 2, 3]]),
        ("X;Y;Z\n1,5;2,25;3\n", [[1.5, 2.25, 3]]),
        ("1\t2\t3\n1\t2,5\t3\n", [[1, 2, 3], [1, 2.5, 3]]),
        ("  1.0   2.0  3.0 \n 10.0\t\t20.0  30.0\n \n", [[1, 2, 3], [10, 20, 30]]),
        ("x,y,z,\n1,2,3,\n+4,5e0,6.,\n", [[1, 2, 3], [4, 5, 6]]),
        ("x y z\n-nan nan 1\n4 5 6\n", [[4, 5, 6]]),
        ("x,y,z,t\n1,2,3,1714564800000000001\n", [[1, 2, 3]]),
        ("x,y,z,i\n1,2,3,\n", [[1, 2, 3]]),
    ],
)
def test_cells(write_file, text, points):
    assert read_cloud(write_file("a.csv", text.encode())).points.tolist() == points


@pytest.mark.parametrize(
    ("name", "text", "count"),
    [
        ("a.pts", "2\n1 2 3 -2048 5 6 7\n1 2 3 0 5 6 7\n# next\n1\n1 2 3 2047 5 6 7\n", 3),
        ("a.pts", "0\n1\n1 2 3 .5 5 6 7\n\n", 1),
        ("a.pts", "1 2 3 .5 5 6 7\n1 2 3 .5 5 6 7\n", 2),
        ("a.asc", "//X Y Z Intensity R G B\n1\n1 2 3 .5 5 6 7\n", 1),
        ("a.asc", "1\n1 2 3 .5 50 60 70\n", 1),
    ],
)
def test_numbers_of_points(write_file, name, text, count):
    cloud = read_cloud(write_file(name, text.encode()))
    assert cloud.points.tolist() == [[1, 2, 3]] * count and len(cloud.colors) == len(cloud.fields["intensity"]) == count


@pytest.mark.parametrize(
    "rows",
    [
        "1 2 3 0 0 1",
        "1 2 3 0 -0.6 0.8",
        "1 2 3 0.1 0.2 0.3",
        "1.5 2.5 3.5 99 2 1",
        "1.5 2.5 3.5 99 1 2 6",
        "1 2 3 -0.05",
        "1 2 3 70000 0 0",
    ],
)
def test_without_names_normals_returns_and_classes_are_no_colours(write_file, rows):
    with pytest.warns(InputWarning, match="taken for fields.*add a line of column names"):
        cloud = read_cloud(write_file("a.xyz", f"{rows}\n".encode()))
    values = list(map(float, rows.split()[3:]))
    assert cloud.colors is None
    assert {name: own[0] for name, own in cloud.fields.items()} == {
        f"column_{number}": value for number, value in enumerate(values, 4)
    }


@pytest.mark.parametrize("values", ["41728.0,40960.0,512.0", "41728,40960,512"])
def test_colours_of_16_bits(write_file, values):
    for head in ('"X","Y","Z","Red","Green","Blue"\n', ""):
        cloud = read_cloud(write_file("a.csv", f"{head}1.0,2.0,3.0,{values}\n".encode()))
        assert cloud.colors.tolist() == [[162, 159, 2]]


@pytest.mark.parametrize("separator", [",", " "])
def test_numbers_of_columns_are_no_point(write_file, separator):
    """As `DataFrame(points).to_csv(index=False)` writes them; whole coordinates may be those of a point."""
    text = "0,1,2\n1.5,2,3\n4,5,6\n".replace(",", separator).encode()
    with pytest.warns(InputWarning, match="line 1 has the numbers of the columns, as of a data frame, and is no point"):
        assert read_cloud(write_file("a.csv", text)).points.tolist() == [[1.5, 2, 3], [4, 5, 6]]
    whole = read_cloud(write_file("a.csv", text.replace(b"1.5", b"1")))
    assert whole.points.tolist() == [[0, 1, 2], [1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize("missing", ["NA", "NULL", "N/A"])
def test_what_data_frames_write_for_nothing_is_nan(write_file, missing):
    cloud = read_cloud(write_file("a.csv", f"x,y,z,intensity\n1,2,3,{missing}\n4,5,6,7\n".encode()))
    np.testing.assert_array_equal(cloud.fields["intensity"], [np.nan, 7])


@pytest.mark.parametrize(
    "text",
    [
        "X;Y;Z;;\r\n1,5;2,5;3,5;;\r\n4,5;5,5;6,5;;\r\n",
        "Vermessung 2024;;\r\n;;\r\nX;Y;Z\r\n1,5;2,5;3,5\r\n4,5;5,5;6,5\r\n",
        "Projekt: A 12\nx y z\n1.5 2.5 3.5\n4.5 5.5 6.5\n",
        "x,y,z\n1.5,2.5,3.5,,\n4.5,5.5,6.5,,\n",
    ],
)
def test_titles_and_empty_columns_of_spreadsheets(write_file, text):
    assert read_cloud(write_file("a.csv", text.encode())).points.tolist() == [[1.5, 2.5, 3.5], [4.5, 5.5, 6.5]]


@pytest.mark.parametrize("text", ['x,y,z,note\n1.5,2,3,"a;b"\n', "x\ty\tz\tnote\n1.5\t2\t3\tred, big\n"])
def test_a_text_does_not_decide_what_separates_the_cells(write_file, text):
    with pytest.warns(InputWarning, match="the column 'note' has text"):
        assert read_cloud(write_file("a.csv", text.encode())).points.tolist() == [[1.5, 2, 3]]


@pytest.mark.parametrize("ending", ["xyz", "csv", "pts"])
def test_a_binary_file_is_called_so(write_file, ending):
    numbers = np.random.default_rng(0).normal(size=600).astype(np.float32).tobytes()
    with pytest.raises(InputError, match="is binary, not text"):
        read_cloud(write_file(f"a.{ending}", numbers + b"\n0 0 0\n"))


def test_an_empty_coordinate_beside_decimal_commas_is_named(write_file):
    with pytest.raises(InputError, match=r"line 3 has an empty cell \(x\)"):
        read_cloud(write_file("a.csv", b"x;y;z\r\n1,5;2,5;3,5\r\n;;\r\n"))
