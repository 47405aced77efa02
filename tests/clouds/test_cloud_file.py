"""Files in chunks: the points of `read_cloud`, bit for bit, whatever the size of the chunks."""

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.clouds import CloudFile, PointCloud, intensity_field, open_cloud, read_cloud, write_pcd, write_ply
from gmmjax.errors import InputError
from tests.clouds.formats import COUNT, WRITERS, write_all


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    write_all(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITERS)
def test_chunks_are_the_points_of_the_file(files, name):
    whole, file = read_cloud(files / name), open_cloud(files / name)
    assert (file.count, file.unit, file.crs) == (len(whole) + whole.rows_dropped, whole.unit, whole.crs)
    assert file.path == files / name and whole.file == file.source

    # Of several processes for each example, where the format has one.
    @settings(max_examples=4 if file.path.suffix in (".laz", ".e57") else 15)
    @given(st.integers(1, COUNT + 3))
    def in_chunks(size):
        chunks = list(file.chunks(size))
        assert max(len(chunk.points) for chunk in chunks) <= size
        np.testing.assert_array_equal(np.concatenate([chunk.points for chunk in chunks]), whole.points)
        np.testing.assert_array_equal(np.concatenate([chunk.rows for chunk in chunks]), whole.rows)
        clouds = list(file.clouds(size))
        for field, values in whole.fields.items():
            joined = np.concatenate([cloud.fields[field] for cloud in clouds])
            assert joined.dtype == values.dtype and joined.tobytes() == values.tobytes()
        if whole.colors is not None:
            np.testing.assert_array_equal(np.concatenate([cloud.colors for cloud in clouds]), whole.colors)

    in_chunks()


@pytest.mark.parametrize("name", WRITERS)
def test_colours_of_some_rows(files, name, monkeypatch):
    monkeypatch.setattr(CloudFile.row_blocks, "__defaults__", (7,))
    whole = read_cloud(files / name)
    random = np.random.default_rng(0)
    # In any order, and some of them twice.
    chosen = random.integers(0, len(whole), 12)
    found = open_cloud(files / name).colors_or_intensity(whole.rows[chosen])
    field = intensity_field(whole.fields)
    if whole.colors is not None:
        assert found.dtype == np.uint8
        np.testing.assert_array_equal(found, whole.colors[chosen])
    elif field is not None:
        np.testing.assert_array_equal(found, whole.fields[field][chosen])
    else:
        assert found is None


def test_colours_without_a_file_that_has_them(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((5, 3)))
    assert open_cloud(tmp_path / "a.npy").colors_or_intensity(np.arange(3)) is None
    write_ply(tmp_path / "a.ply", np.zeros((5, 3)), fields={"scalar_Intensity": np.arange(5.0)})
    file = open_cloud(tmp_path / "a.ply")
    np.testing.assert_array_equal(file.colors_or_intensity(np.array([3, 0, 3])), [3, 0, 3])
    assert file.colors_or_intensity(np.arange(0)).shape == (0,)


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_was_changed_since_it_was_opened(files, tmp_path, name):
    path = tmp_path / f"<b>{name}"
    path.write_bytes((files / name).read_bytes())
    file = open_cloud(path)
    chunks = file.chunks(5)
    next(chunks)
    os.truncate(path, path.stat().st_size // 2)
    with pytest.raises(InputError, match=r"<b>.* was changed since it was read"):
        list(file.chunks(5))
    with pytest.raises(InputError):
        open_cloud(path).read()


def test_a_file_that_is_cut_off_between_two_blocks(files, tmp_path, monkeypatch):
    monkeypatch.setattr("gmmjax.clouds.records.BLOCK", 200)
    for name in ("a.las", "a.ply", "b.pcd", "a.npy"):
        path = tmp_path / name
        path.write_bytes((files / name).read_bytes())
        chunks = open_cloud(path).chunks(5)
        next(chunks)
        os.truncate(path, path.stat().st_size // 2)
        with pytest.raises(InputError, match=name):
            list(chunks)


def test_what_is_no_size(files):
    with pytest.raises(InputError, match="size must be at least 1"):
        next(open_cloud(files / "a.ply").chunks(0))


def test_bounds_are_those_of_the_header(files):
    bounds, points = open_cloud(files / "a.laz").bounds, read_cloud(files / "a.laz").points
    np.testing.assert_allclose(bounds.lower, points.min(axis=0))
    np.testing.assert_allclose(bounds.upper, points.max(axis=0))


def test_views_are_those_of_the_cloud(tmp_path):
    """An ordered frame, whose view is that of its pose."""
    depth = np.random.default_rng(0).uniform(1, 2, (6, 8))
    columns, rows = np.meshgrid(np.arange(8) - 3.5, np.arange(6) - 2.5)
    frame = np.stack([columns * depth / 8, rows * depth / 8, depth], axis=2)
    write_pcd(tmp_path / "a.pcd", frame)
    views = open_cloud(tmp_path / "a.pcd").views
    assert views is not None and not views.turning
    np.testing.assert_array_equal(views.poses, read_cloud(tmp_path / "a.pcd").views.poses)


def test_clouds_in_memory_remember_their_file(files):
    assert isinstance(read_cloud(files / "a.xyz"), PointCloud)
    assert read_cloud(files / "a.xyz").file.path == files / "a.xyz"
