import dataclasses
import json

import numpy as np
import pytest

from gmmjax import Change, Changes, DetectionConfig, InputError
from gmmjax.changes import Box
from gmmjax.changes.storage import OPTIONAL_ARRAYS, POINT_ARRAYS
from tests.changes.explained import explanation, rejected


def example():
    random = np.random.default_rng(0)
    box, motion = Box.around(random.normal(size=(40, 3))), np.eye(4)
    change = Change(
        "moved", 0.75, 6.5, 40, np.arange(3.0), np.eye(3), box, partner=0, transform=motion, moved_probability=0.9
    )
    change = dataclasses.replace(change, explanation=explanation(), volume=0.25)
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
        rejected=(rejected(), rejected("appeared", "not observed", 0.1, 0.2)),
        distance_before=np.r_[np.nan, np.linspace(-0.1, 0.1, 29)],
        distance_after=np.zeros(50),
        level_of_detection_before=np.r_[np.nan, np.full(29, 0.02)],
        level_of_detection_after=np.full(50, 0.01, np.float32),
        significance_before=np.r_[np.nan, np.linspace(9.8, 0, 28), np.inf],
        significance_after=np.zeros(50),
        warnings=("extents differ",),
        unit="m",
    )


def test_records_without_the_probability_of_a_motion_are_read(tmp_path):
    file = example().save(tmp_path) / "changes.json"
    content = json.loads(file.read_text())
    del content["changes"][0]["moved_probability"]
    file.write_text(json.dumps(content))
    assert Changes.load(tmp_path)[0].moved_probability is None


def test_diagnostics_that_are_not_finite_are_null(tmp_path):
    numbers = {"residual": float("inf"), "each": [1.0, float("nan"), (2, float("-inf"))], "applied": True, "deep": None}
    changes = dataclasses.replace(example(), diagnostics={"registration": numbers})
    content = json.loads((changes.save(tmp_path) / "changes.json").read_text())
    expected = {"residual": None, "each": [1.0, None, [2, None]], "applied": True, "deep": None}
    assert content["diagnostics"] == {"registration": expected}
    assert Changes.load(tmp_path).to_dict() == changes.to_dict()


def test_recognised_stations_are_loaded_and_none_where_none_are_recorded(tmp_path):
    stations = {"before": {"recognised_stations": [[0.0, 1.0, 1.5], [4.0, 1.0, 1.5]]}, "after": {"points": 30}}
    dataclasses.replace(example(), diagnostics=stations).save(tmp_path)
    before, after = Changes.load(tmp_path).recognised_stations()
    np.testing.assert_array_equal(before, [[0.0, 1.0, 1.5], [4.0, 1.0, 1.5]])
    assert after.shape == (0, 3)
    assert dataclasses.replace(example(), diagnostics={}).recognised_stations().before.shape == (0, 3)


def test_what_is_saved_is_loaded(tmp_path):
    changes = example()
    folder = changes.save(tmp_path / "deep" / "result")
    for path in (folder, folder / "changes.json"):
        loaded = Changes.load(path)
        assert loaded.to_dict() == changes.to_dict()
        assert loaded.config == changes.config
        for name in (*POINT_ARRAYS, *OPTIONAL_ARRAYS):
            np.testing.assert_array_equal(getattr(loaded, name), getattr(changes, name))
        assert (loaded.warnings, loaded.unit, loaded[0].volume) == (("extents differ",), "m", 0.25)
        np.testing.assert_array_equal(loaded.items[0].box.rotation, changes.items[0].box.rotation)
        np.testing.assert_array_equal(loaded.items[0].transform, np.eye(4))
        assert loaded.items[0].significance == 6.5
        assert loaded.items[0].explanation == changes.items[0].explanation
        assert [one.reason for one in loaded.rejected] == ["unchanged", "not observed"]
        assert loaded.rejected[1].explanation == changes.rejected[1].explanation


def test_records_of_before_there_were_explanations_are_loaded(tmp_path):
    file = example().save(tmp_path) / "changes.json"
    content = json.loads(file.read_text())
    del content["rejected"], content["changes"][0]["explanation"]
    file.write_text(json.dumps(content))
    loaded = Changes.load(tmp_path)
    assert loaded.items[0].explanation is None
    assert loaded.rejected == ()
    assert loaded.items[0].partner == 0


def test_records_without_distances_volumes_and_warnings_are_loaded(tmp_path):
    file = dataclasses.replace(example(), **dict.fromkeys(OPTIONAL_ARRAYS)).save(tmp_path) / "changes.json"
    content = json.loads(file.read_text())
    del content["warnings"], content["unit"], content["changes"][0]["volume"]
    file.write_text(json.dumps(content))
    loaded = Changes.load(tmp_path)
    assert all(getattr(loaded, name) is None for name in OPTIONAL_ARRAYS)
    assert (loaded.warnings, loaded.unit, loaded[0].volume) == ((), None, None)


def test_changes_are_a_sequence():
    changes = example()
    one, other = changes.items[0], dataclasses.replace(changes.items[0], point_count=7)
    two = dataclasses.replace(changes, items=(one, other))
    assert len(two) == 2 and list(two) == [one, other]
    assert two[0] is one and two[-1] is other and two[1:] == (other,) and one in two
    assert two[int(changes.labels_after[0])] is one
    with pytest.raises(IndexError):
        two[2]


def test_no_changes_are_false():
    nothing = dataclasses.replace(example(), items=())
    assert not nothing and len(nothing) == 0 and list(nothing) == []
    assert example()


def test_dictionary_is_json_with_a_schema_version():
    content = json.loads(json.dumps(example().to_dict(), allow_nan=False))
    assert content["schema_version"] == 3
    assert content["changes"][0]["kind"] == "moved"


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("changes.json", b"{", "is not JSON"),
        ("changes.json", b"\xff\xfe", "is not JSON"),
        ("changes.json", b'{"schema_version": 99}', "schema version 99.*written by a newer gmmjax: update this one"),
        ("changes.json", b'{"schema_version": 1}', "schema version 1, this gmmjax reads version 3; run the detection"),
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


@pytest.mark.parametrize(
    ("replaced", "by", "message"),
    [
        ('"emd": 0.25', '"emd": NaN', "NaN is no number"),
        ('"emd": 0.25', '"emd": 1e999', "too large"),
        ('"emd": 0.25', '"emd": "nan"', "'nan' must be finite numbers"),
        ('"emd": 0.25', '"emd": true', "True must be finite numbers"),
        ('"emd": 0.25', '"emd": ' + "9" * 5000, "5000 digits"),
        ('"emd": 0.25', '"emd": ' + "[" * 5000, "nested too deeply"),
        ('"kind": "moved"', '"kind": "vanished"', "kind 'vanished' is none of appeared, disappeared, moved"),
        ('"point_count": 40', '"point_count": -1', "-1 must be a whole number"),
        ('"partner": 0', '"partner": 7', "a partner beyond the 1 changes"),
        ('"partner": 0', '"partner": 0.5', "0.5 must be a whole number"),
        ('"moved_probability": 0.9', '"moved_probability": 1.5', "1.5 must lie between 0 and 1"),
        ('"volume": 0.25', '"volume": "much"', "'much' must be finite numbers"),
        ('"unit": "m"', '"unit": 3', "3 must be a text"),
        ('"box": {', '"box": null, "other": {', "not a complete record"),
        ('"log_odds": 3.14', '"log_odds": NaN', "NaN is no number"),
        ('"log_odds": 3.14', '"log_odds": "NaN"', "'NaN' must be finite numbers"),
        ('"changed": 0.9,', '"changed": 1.5,', "1.5 must lie between 0 and 1"),
        ('"explanation": {', '"explanation": [], "other": {', "not a complete record"),
        ('"rejected": [', '"rejected": null, "other": [', "not a complete record"),
        ('"reason": "not observed"', '"reason": "hidden"', "'hidden' is none of unchanged, not observed"),
        ('"kind": "disappeared"', '"kind": "vanished"', "kind 'vanished' is none of appeared, disappeared"),
        ('"diagnostics": {', '"diagnostics": null, "other": {', "not a complete record"),
        ('"config": {', '"config": {"seed": 1e5,', "seed"),
        ('"points_after": 50', '"points_after": 51', "labels_after of 50 points, changes of 51"),
        ('"changes": [', '"changes": [], "other": [', "labels_after run from -1 to 0, of 0 changes"),
    ],
)
def test_records_with_wrong_values_are_refused(tmp_path, replaced, by, message):
    file = example().save(tmp_path) / "changes.json"
    text = file.read_text()
    # What a change and the rejected candidates have in common is replaced in the change.
    assert replaced in text
    # Of a name that is there twice the last counts.
    file.write_text(text.replace(replaced, by, 1) if "seed" not in by else text.replace('"seed": 3', '"seed": 1e5'))
    with pytest.raises(InputError, match=message) as caught:
        Changes.load(tmp_path)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("labels_after", np.zeros(50), r"a whole number for each point, not float64 \[50\]"),
        ("probability_after", np.full(50, np.nan), "must lie between 0 and 1"),
        ("probability_before", np.zeros(7), r"a number for each point, not float64 \[7\]"),
        ("unobserved_before", np.zeros(30), r"a bool for each point, not float64 \[30\]"),
        ("unobserved_before", None, "not nothing"),
        ("distance_before", np.zeros(29), r"a number for each point, not float64 \[29\]"),
        ("level_of_detection_after", np.zeros(50, int), r"a number for each point, not int64 \[50\]"),
        ("significance_before", np.zeros((30, 1)), r"a number for each point, not float64 \[30, 1\]"),
    ],
)
def test_labels_that_do_not_fit_are_refused(tmp_path, name, values, message):
    changes = example()
    changes.save(tmp_path)
    arrays = {own: getattr(changes, own) for own in POINT_ARRAYS} | {name: values}
    np.savez(tmp_path / "labels.npz", **{own: kept for own, kept in arrays.items() if kept is not None})
    with pytest.raises(InputError, match=rf"labels\.npz: {name} .*{message}"):
        Changes.load(tmp_path)


def test_pickled_labels_are_not_read(tmp_path):
    example().save(tmp_path)
    arrays = {name: np.array([{}], dtype=object) for name in ("labels_before", "labels_after")}
    np.savez(tmp_path / "labels.npz", **arrays, allow_pickle=True)
    with pytest.raises(InputError, match="labels"):
        Changes.load(tmp_path)
