import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax import Change, Changes, DetectionConfig, InputError
from gmmjax.changes import Box
from gmmjax.changes.storage import POINT_ARRAYS
from tests.mixtures.examples import random_rotation


def example():
    random = np.random.default_rng(0)
    box, motion = Box.around(random.normal(size=(40, 3))), np.eye(4)
    change = Change("moved", 0.75, 6.5, 40, np.arange(3.0), np.eye(3), box, partner=0, transform=motion)
    return Changes(
        labels_before=np.full(30, -1),
        labels_after=np.r_[np.zeros(40, int), np.full(10, -1)],
        probability_before=np.zeros(30),
        probability_after=random.uniform(size=50),
        unobserved_before=np.arange(30) < 4,
        unobserved_after=np.zeros(50, bool),
        items=(change,),
        emd=0.25,
        config=DetectionConfig(method="transport", seed=3),
        diagnostics={"voxel_size": None, "before": {"points": 30}},
    )


@given(seed=st.integers(0, 10**6), count=st.integers(1, 40))
def test_box_holds_all_points_tightly(seed, count):
    points = np.random.default_rng(seed).normal(size=(count, 3)) * np.array([3, 1, 0.2]) + 1e3
    box = Box.around(points)
    inside = (points - box.centre) @ box.rotation
    assert (np.abs(inside) <= box.extent / 2 + 1e-9).all()
    np.testing.assert_allclose(2 * np.abs(inside).max(axis=0), box.extent, atol=1e-9)
    assert (np.diff(box.extent) <= 1e-12).all()
    np.testing.assert_allclose(np.linalg.det(box.rotation), 1)
    np.testing.assert_allclose(box.corners().mean(axis=0), box.centre)


def test_box_turns_with_its_points():
    points, rotation = np.random.default_rng(0).normal(size=(200, 3)) * np.array([3, 1, 0.2]), random_rotation()
    box, turned = Box.around(points), Box.around(points @ rotation.T)
    np.testing.assert_allclose(turned.extent, box.extent)
    np.testing.assert_allclose(turned.centre, rotation @ box.centre, atol=1e-9)


def test_diagnostics_that_are_not_finite_are_null(tmp_path):
    numbers = {"residual": float("inf"), "each": [1.0, float("nan"), (2, float("-inf"))], "applied": True, "deep": None}
    changes = dataclasses.replace(example(), diagnostics={"registration": numbers})
    content = json.loads((changes.save(tmp_path) / "changes.json").read_text())
    expected = {"residual": None, "each": [1.0, None, [2, None]], "applied": True, "deep": None}
    assert content["diagnostics"] == {"registration": expected}
    assert Changes.load(tmp_path).to_dict() == changes.to_dict()


def test_what_is_saved_is_loaded(tmp_path):
    changes = example()
    folder = changes.save(tmp_path / "deep" / "result")
    for path in (folder, folder / "changes.json"):
        loaded = Changes.load(path)
        assert loaded.to_dict() == changes.to_dict()
        assert loaded.config == changes.config
        for name in POINT_ARRAYS:
            np.testing.assert_array_equal(getattr(loaded, name), getattr(changes, name))
        np.testing.assert_array_equal(loaded.items[0].box.rotation, changes.items[0].box.rotation)
        np.testing.assert_array_equal(loaded.items[0].transform, np.eye(4))
        assert loaded.items[0].significance == 6.5


def test_dictionary_is_json_with_a_schema_version():
    content = json.loads(json.dumps(example().to_dict(), allow_nan=False))
    assert content["schema_version"] == 3
    assert content["changes"][0]["kind"] == "moved"


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("changes.json", b"{", "is not JSON"),
        ("changes.json", b"\xff\xfe", "is not JSON"),
        ("changes.json", b'{"schema_version": 99}', "schema version 99"),
        ("changes.json", b'{"schema_version": 1}', "schema version 1"),
        ("changes.json", b"[1]", "schema version None"),
        ("changes.json", b'{"schema_version": 3}', "not a complete record"),
        ("labels.npz", b"PK garbage", "labels"),
        ("labels.npz", None, "labels"),
        ("changes.json", None, "changes.json"),
    ],
)
def test_damaged_records_are_named(tmp_path, file, content, message):
    example().save(tmp_path)
    if content is None:
        (tmp_path / file).unlink()
    else:
        (tmp_path / file).write_bytes(content)
    with pytest.raises(InputError, match=message):
        Changes.load(tmp_path)


def test_pickled_labels_are_not_read(tmp_path):
    example().save(tmp_path)
    arrays = {name: np.array([{}], dtype=object) for name in ("labels_before", "labels_after")}
    np.savez(tmp_path / "labels.npz", **arrays, allow_pickle=True)
    with pytest.raises(InputError, match="labels"):
        Changes.load(tmp_path)
