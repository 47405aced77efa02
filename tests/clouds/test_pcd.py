import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.clouds import read_cloud
from gmmjax.errors import InputError

ENCODINGS = ["ascii", "binary", "binary_compressed"]
ROW = np.dtype(
    [("x", "<f4"), ("y", "<f8"), ("_", "u1", 3), ("z", "<f4"), ("rgb", "<u4"), ("stamp", "<i8"), ("bins", "<i2", 2)]
)
COMMENT = "# .PCD v0.7 - Point Cloud Data file format"


def header(encoding: str, points: int, row: np.dtype = ROW, **changes: str) -> bytes:
    kinds = [row.fields[name][0] for name in row.names]
    lines = {
        "VERSION": "0.7",
        "FIELDS": " ".join(row.names),
        "SIZE": " ".join(str(kind.base.itemsize) for kind in kinds),
        "TYPE": " ".join(kind.base.kind.upper() for kind in kinds),
        "COUNT": " ".join(str(int(np.prod(kind.shape, dtype=int))) for kind in kinds),
        "WIDTH": str(points),
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(points),
        "DATA": encoding,
    } | changes
    return "\n".join([COMMENT, *(f"{key} {value}" for key, value in lines.items() if value), ""]).encode()


def body(encoding: str, rows: np.ndarray, compress, padding: bool = False) -> bytes:
    if encoding == "binary":
        return rows.tobytes()
    if encoding == "ascii":
        # Repr has all the digits of a number.
        return "".join(
            " ".join(repr(number.item()) for name in rows.dtype.names for number in np.atleast_1d(row[name])) + "\n"
            for row in rows
        ).encode()
    blocks = b"".join(rows[name].tobytes() for name in rows.dtype.names if padding or name != "_")
    compressed = compress(blocks)
    return np.array([len(compressed), len(blocks)], "<u4").tobytes() + compressed


def some_rows(seed: int, count: int, row: np.dtype = ROW) -> np.ndarray:
    generator = np.random.default_rng(seed)
    rows = np.zeros(count, row)
    for name in row.names:
        kind = rows[name].dtype
        shape = rows[name].shape
        rows[name] = (
            generator.normal(size=shape)
            if kind.kind == "f"
            else generator.integers(0, min(np.iinfo(kind).max, 2**40), shape)
        )
    return rows


@pytest.mark.parametrize("padding", [False, True])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_all_encodings(write_file, lzf_compress, encoding, padding):
    rows = some_rows(0, 200)
    rows["rgb"][:3] = [0x00FF8001, 0xFF010203, 0]
    content = header(encoding, 200) + body(encoding, rows, lzf_compress, padding)
    cloud = read_cloud(write_file("cloud.PCD", content))
    np.testing.assert_array_equal(cloud.points, np.stack([rows["x"], rows["y"], rows["z"]], axis=1))
    np.testing.assert_array_equal(cloud.colors[:3], [[255, 128, 1], [1, 2, 3], [0, 0, 0]])
    assert list(cloud.fields) == ["stamp", "bins_0", "bins_1"]
    np.testing.assert_array_equal(cloud.fields["stamp"], rows["stamp"])
    np.testing.assert_array_equal(cloud.fields["bins_1"], rows["bins"][:, 1])
    assert cloud.fields["bins_1"].dtype == np.int16


@given(st.integers(0, 2**32), st.integers(1, 30), st.permutations(["x", "y", "z", "a", "b"]), st.data())
def test_any_layout(write_file, lzf_compress, seed, count, names, data):
    kinds = {name: data.draw(st.sampled_from(["<f4", "<f8"])) for name in "xyz"}
    kinds |= {
        name: data.draw(st.sampled_from(["<i1", "<u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8"])) for name in "ab"
    }
    row = np.dtype([(name, kinds[name]) for name in names])
    rows = some_rows(seed, count, row)
    for encoding in ENCODINGS:
        cloud = read_cloud(write_file("a.pcd", header(encoding, count, row) + body(encoding, rows, lzf_compress)))
        np.testing.assert_array_equal(cloud.points, np.stack([rows[name] for name in "xyz"], axis=1))
        for name in "ab":
            np.testing.assert_array_equal(cloud.fields[name], rows[name])
            assert cloud.fields[name].dtype == rows[name].dtype


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("name", ["rgb", "rgba"])
def test_colors_packed_into_floats(write_file, lzf_compress, encoding, name):
    row = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), (name, "<f4")])
    rows = np.zeros(2, row)
    rows[name] = np.array([0x00102030, 0x00FFFE80], np.uint32).view(np.float32)
    if encoding == "ascii":
        rows = rows[:1]  # the other one is a NaN, which text cannot hold
    content = header(encoding, len(rows), row) + body(encoding, rows, lzf_compress)
    assert read_cloud(write_file("a.pcd", content)).colors.tolist() == [[16, 32, 48], [255, 254, 128]][: len(rows)]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_organised_clouds_lose_the_pixels_without_depth(write_file, lzf_compress, encoding):
    rows = some_rows(1, 6)
    rows["z"][[0, 4]] = np.nan
    content = header(encoding, 6, WIDTH="3", HEIGHT="2") + body(encoding, rows, lzf_compress)
    cloud = read_cloud(write_file("a.pcd", content))
    assert (cloud.rows.tolist(), cloud.rows_dropped) == ([1, 2, 3, 5], 2)
    np.testing.assert_array_equal(cloud.fields["stamp"], rows["stamp"][cloud.rows])


def test_optional_header_lines(write_file):
    row = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    content = header("ascii", 1, row, VERSION="", COUNT="", HEIGHT="", POINTS="", VIEWPOINT="")
    assert read_cloud(write_file("a.pcd", content + b"1 2 3")).points.tolist() == [[1, 2, 3]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"DATA": "gzip"}, "no line DATA with one of ascii, binary, binary_compressed"),
        ({"SIZE": "4 4"}, "needs a line SIZE with 3 whole"),
        ({"SIZE": "4 3 4"}, "TYPE .* and SIZE do not fit"),
        ({"TYPE": "F F"}, "TYPE .* and SIZE do not fit"),
        ({"WIDTH": "-1"}, "needs a line WIDTH"),
        ({"POINTS": "3"}, "POINTS is 3, WIDTH times HEIGHT is 2"),
        ({"FIELDS": "x y x"}, "'x'.* more than once"),
        ({"FIELDS": "x y a"}, "no z, only: x, y, a"),
        ({"COUNT": "1 1 0"}, "no z, only: x, y"),
        ({"HEIGHT": "1\nCOLOUR 3"}, "line 9 of the PCD header"),
        ({"WIDTH": "0", "POINTS": "0"}, "has 0 points"),
    ],
)
def test_wrong_headers(write_file, changes, message):
    row = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    path = write_file("a.pcd", header("binary", 2, row, **changes) + bytes(24))
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("encoding", "message"),
    [
        ("ascii", "declares 9 points, 5 are there"),
        ("binary", "declares 9 points, 5 are there"),
        ("binary_compressed", "holds .* bytes for 9 points"),
    ],
)
def test_fewer_points_than_declared(write_file, lzf_compress, encoding, message):
    path = write_file("a.pcd", header(encoding, 9) + body(encoding, some_rows(2, 5), lzf_compress))
    with pytest.raises(InputError, match=message):
        read_cloud(path)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_cut_anywhere_is_an_input_error(write_file, lzf_compress, encoding):
    whole = header(encoding, 4) + body(encoding, some_rows(3, 4), lzf_compress)
    if encoding == "ascii":
        # The last number, cut, is still a number, and a line end is no duty: such a cut cannot be seen.
        whole = whole.rsplit(b" ", 1)[0] + b" "
    for cut in range(len(whole)):
        with pytest.raises(InputError):
            read_cloud(write_file("cut.pcd", whole[:cut]))


def test_equals_open3d(open3d, tmp_path):
    generator = np.random.default_rng(0)
    # Rounded, so that the references of the compression are used.
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(generator.normal(size=(2000, 3)).round(1)))
    cloud.colors = open3d.utility.Vector3dVector(generator.integers(0, 256, (2000, 3)) / 255)
    for options in ({}, {"write_ascii": True}, {"compressed": True}):
        path = tmp_path / "cloud.pcd"
        open3d.io.write_point_cloud(str(path), cloud, **options)
        theirs, ours = open3d.io.read_point_cloud(str(path)), read_cloud(path)
        np.testing.assert_allclose(ours.points, np.asarray(theirs.points), rtol=1e-7, atol=1e-9)
        np.testing.assert_array_equal(ours.colors, np.rint(np.asarray(theirs.colors) * 255))


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_names_in_upper_case(write_file, encoding):
    row = np.dtype([("X", "<f4"), ("Y", "<f4"), ("Z", "<f4"), ("R", "u1"), ("G", "u1"), ("B", "u1"), ("Label", "<i4")])
    rows = np.array([(1, 2, 3, 9, 8, 7, 5)], row)
    cloud = read_cloud(write_file("a.pcd", header(encoding, 1, row) + body(encoding, rows, None)))
    assert (cloud.points.tolist(), cloud.colors.tolist()) == ([[1, 2, 3]], [[9, 8, 7]])
    assert cloud.fields["Label"].tolist() == [5]
