import io
import zipfile

import numpy as np
import pytest

from gmmjax.clouds import read_cloud, write_archive
from gmmjax.errors import InputError

POINTS = np.arange(12.0).reshape(4, 3)


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def npz(**arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


@pytest.mark.parametrize(
    "array", [POINTS, POINTS.astype(np.float32), POINTS.astype(">f8"), POINTS.astype(int), np.asfortranarray(POINTS)]
)
def test_npy_of_any_real_type(write_file, array):
    np.testing.assert_array_equal(read_cloud(write_file("a.npy", npy(array))).points, POINTS)


def test_ordered_clouds_are_flattened_row_by_row(write_file):
    ordered = POINTS.reshape(2, 2, 3).copy()
    ordered[0, 1, 2] = np.nan
    cloud = read_cloud(write_file("a.npy", npy(ordered)))
    np.testing.assert_array_equal(cloud.points, POINTS[[0, 2, 3]])
    assert (cloud.rows.tolist(), cloud.rows_dropped) == ([0, 2, 3], 1)


def test_further_columns_are_fields(write_file):
    cloud = read_cloud(write_file("a.npy", npy(np.hstack([POINTS, POINTS[:, :2] + 100]))))
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_array_equal(cloud.fields["column_4"], POINTS[:, 1] + 100)


@pytest.mark.parametrize("shape", [(4,), (2, 2)])
def test_npz(write_file, shape):
    colors = np.arange(12, dtype=np.uint8).reshape(*shape, 3)
    label = np.arange(4).reshape(shape)
    content = npz(points=POINTS.reshape(*shape, 3), colors=colors, label=label, pose=np.eye(4)[:3])
    cloud = read_cloud(write_file("a.npz", content))
    np.testing.assert_array_equal(cloud.points, POINTS)
    np.testing.assert_array_equal(cloud.colors, colors.reshape(4, 3))
    assert list(cloud.fields) == ["label"]
    assert cloud.fields["label"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.npy", npy(np.array([[1, 2, 3]], dtype=object)), "pickled Python objects, which are not read"),
        ("a.npz", npz(points=np.array([[1, 2, 3]], dtype=object)), "pickled Python objects, which are not read"),
        ("a.npy", b"\x80\x04K\x01.", "pickled Python objects, which are not read"),
        ("a.npz", npz(cloud=POINTS, label=np.arange(4)), "no array 'points', only: cloud, label"),
        ("a.npz", npz(points=POINTS, colors=np.zeros((4, 3))), "colors must be uint8"),
        ("a.npy", npz(points=POINTS), "rename it to .npz"),
        ("a.npz", npy(POINTS), "rename it to .npy"),
        ("a.npy", npy(np.zeros((3, 100))), r"shape \[3, 100\].*transpose"),
        ("a.npy", npy(np.zeros(7)), r"shape \[7\]"),
        ("a.npy", npy(np.zeros((7, 2))), r"shape \[7, 2\]"),
        ("a.npy", npy(np.zeros((7, 3), complex)), "complex128, not real numbers"),
        ("a.npy", npy(np.zeros((0, 3))), "has 0 points"),
        ("a.npy", npy(POINTS)[:-1], "NumPy cannot read it"),
        ("a.npy", npy(POINTS).replace(b"(4, 3)", b"(9000000000000, 3)"), "NumPy cannot read it"),
    ],
)
def test_what_is_wrong_is_said(write_file, name, content, message):
    path = write_file(name, content)
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(("name", "content"), [("a.npy", npy(POINTS)), ("a.npz", npz(points=POINTS))])
def test_cut_anywhere_is_an_input_error(write_file, name, content):
    for cut in range(len(content)):
        with pytest.raises(InputError):
            read_cloud(write_file(name, content[:cut]))


def test_members_that_are_no_arrays(write_file, tmp_path):
    whole = npz(points=POINTS, label=np.arange(4))
    path = write_file("a.npz", whole)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("readme.txt", "three columns")
    assert list(read_cloud(path).fields) == ["label"]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("points.npy", "three columns")
    with pytest.raises(InputError, match=f"{path}: has no array 'points', only: none"):
        read_cloud(path)


def test_an_archive_that_is_written_in_parts_is_numpys(tmp_path):
    arrays = {"labels": np.arange(-1, 24, dtype=np.int32), "unobserved": np.arange(25) % 2 == 0, "none": np.empty(0)}
    with (tmp_path / "labels.npz").open("wb") as file:
        write_archive(file, arrays, part=7)
    with np.load(tmp_path / "labels.npz", allow_pickle=False) as found:
        assert set(found) == set(arrays)
        for name, values in arrays.items():
            assert found[name].dtype == values.dtype
            np.testing.assert_array_equal(found[name], values)
