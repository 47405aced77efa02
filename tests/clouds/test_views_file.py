import json
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.clouds import SensorViews, read_views, write_views
from gmmjax.errors import InputError


def some_views(seed=0, count=2):
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=seed).as_matrix()
    poses[:, :3, 3] = np.random.default_rng(seed).normal(0, 5, (count, 3))
    return SensorViews(poses, (62.0, 48.5), 4.25)


@pytest.mark.parametrize("name", ["views.json", "views.npz", "VIEWS.JSON"])
@given(seed=st.integers(0, 2**32 - 1))
def test_written_and_read_back(tmp_path_factory, name, seed):
    path, views = tmp_path_factory.mktemp("views") / name, some_views(seed)
    write_views(path, views)
    back = read_views(path)
    np.testing.assert_array_equal(back.poses, views.poses)
    assert (back.field_of_view, back.max_range) == (views.field_of_view, views.max_range)


def test_written_by_hand(tmp_path):
    path = tmp_path / "views.json"
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
    path.write_text(json.dumps({"poses": [pose], "field_of_view": [60, 45], "max_range": 4, "camera": "depth"}))
    views = read_views(path)
    assert views.poses[0, 2, 3] == 0.5
    assert views.max_range == 4.0


GOOD = {"poses": np.eye(4)[None].tolist(), "field_of_view": [60, 45], "max_range": 4.0}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[1, 2]", "must hold an object with poses, field_of_view, max_range, not a list"),
        ("{}", "has no poses, field_of_view, max_range, only: nothing"),
        (json.dumps(GOOD | {"max_range": "far"}), "max_range='far' must be"),
        (json.dumps(GOOD | {"max_range": None}), "max_range=None must be"),
        (json.dumps(GOOD | {"poses": {"first": 1}}), "poses must be numbers"),
        (json.dumps(GOOD | {"field_of_view": 60}), "field_of_view=60 must be two angles"),
        (json.dumps(GOOD | {"poses": [[1, 2], [3]]}), "poses must be numbers"),
        (json.dumps(GOOD | {"poses": (2 * np.eye(4))[None].tolist()}), "pose 0 of 1 is not rigid"),
        (json.dumps({name: GOOD[name] for name in ("poses", "max_range")}), "has no field_of_view, only: poses, max"),
    ],
)
def test_json_that_cannot_be_used(tmp_path, content, message):
    path = tmp_path / "views.json"
    path.write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        read_views(path)
    assert str(caught.value).startswith(str(path))


def test_npz_that_cannot_be_used(tmp_path):
    path = tmp_path / "views.npz"
    for arrays, message in (
        ({"points": np.zeros((3, 3))}, "has no poses"),
        (GOOD | {"poses": np.array([{}], object)}, "is no NPZ file of numbers"),
        (GOOD | {"max_range": np.array([1.0, 2])}, "max_range"),
        (GOOD | {"field_of_view": np.array(["60", "x"])}, "field_of_view"),
        (GOOD | {"poses": np.full((1, 4, 4), 1e300)}, "pose 0 of 1 is not rigid"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=message) as caught:
            read_views(path)
        assert str(caught.value).startswith(str(path))
    write_views(path, some_views())
    whole = path.read_bytes()
    for cut in range(1, len(whole), 37):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"views\.npz: is no NPZ file of numbers"):
            read_views(path)


def test_names_and_folders(tmp_path):
    with pytest.raises(InputError, match=r"views\.json: no such file"):
        read_views(tmp_path / "views.json")
    (tmp_path / "views.txt").write_text("{}")
    with pytest.raises(InputError, match=r"end with \.json or \.npz; rename it"):
        read_views(tmp_path / "views.txt")
    with pytest.raises(InputError, match=r"end with \.json or \.npz; rename it"):
        write_views(tmp_path / "views", some_views())
    with pytest.raises(InputError, match="create the folder"):
        write_views(tmp_path / "missing" / "views.json", some_views())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["views.txt"]


def test_npz_whose_members_are_no_arrays(tmp_path):
    path = tmp_path / "views.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("poses", "field_of_view", "max_range"):
            archive.writestr(f"{name}.npy", "no array")
    with pytest.raises(InputError, match=r"views\.npz: has no poses, field_of_view, max_range, only: nothing"):
        read_views(path)
