import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.clouds import SensorViews, write_ply, write_views
from gmmjax.tuning import find_tuning_pairs


def put(folder, *, truth=(), unseen=()):
    """A pair of ten points; truth and unseen for these sides."""
    folder.mkdir()
    for side in ("before", "after"):
        write_ply(folder / f"{side}.ply", np.random.default_rng(0).normal(size=(10, 3)))
    for side in truth:
        np.save(folder / f"truth_{side}.npy", np.arange(10) - 8)
    for side in unseen:
        np.save(folder / f"unseen_{side}.npy", np.arange(10) < 3)


def test_reads_pairs_with_truth(tmp_path):
    put(tmp_path / "a", truth=("before", "after"), unseen=("after",))
    (pair,) = find_tuning_pairs(tmp_path)
    assert pair.name == "a" and pair.labelled
    np.testing.assert_array_equal(pair.truth_after, np.arange(10) - 8)
    assert not pair.ignored_before.any() and pair.ignored_after.sum() == 3


def test_reads_pairs_without_truth(tmp_path):
    put(tmp_path / "a")
    put(tmp_path / "b")
    pairs = find_tuning_pairs(tmp_path)
    assert [pair.name for pair in pairs] == ["a", "b"] and not any(pair.labelled for pair in pairs)


def test_truth_for_some_is_an_error(tmp_path):
    put(tmp_path / "a", truth=("before", "after"))
    put(tmp_path / "b")
    with pytest.raises(InputError, match=r"b have no truth, other pairs have"):
        find_tuning_pairs(tmp_path)


def test_pairs_without_truth_may_be_unchanged(tmp_path):
    put(tmp_path / "a", truth=("before", "after"))
    put(tmp_path / "b")
    write_views(tmp_path / "b" / "views_after.json", SensorViews.at_origin(np.array([[0.0, 0.0, 1.0]])))
    labelled, unchanged = find_tuning_pairs(tmp_path, unchanged=True)
    assert labelled.labelled and labelled.truth_after.max() == 1
    assert unchanged.labelled and (unchanged.truth_before == -1).all() and len(unchanged.truth_after) == 10
    assert unchanged.views_before is None and len(unchanged.views_after) == 1


def test_the_hidden_part_of_a_change_that_is_not_counted_is_not_judged(tmp_path):
    put(tmp_path / "a", truth=("before", "after"), unseen=("after",))
    truth = np.where(np.arange(10) < 5, 0, -1)
    np.save(tmp_path / "a" / "truth_after.npy", truth)
    np.save(tmp_path / "a" / "not_counted_after.npy", np.array([0]))
    np.save(tmp_path / "a" / "unseen_after.npy", np.arange(10) >= 4)
    (pair,) = find_tuning_pairs(tmp_path)
    np.testing.assert_array_equal(pair.unseen_after, np.arange(10) >= 5)
    assert pair.unseen_before is None and pair.ignored_after.all()


def test_truth_of_one_side_is_an_error(tmp_path):
    put(tmp_path / "a", truth=("before",))
    with pytest.raises(InputError, match=r"truth_after.npy: is missing"):
        find_tuning_pairs(tmp_path)


def test_a_folder_without_pairs_is_an_error(tmp_path):
    with pytest.raises(InputError, match="holds no pairs"):
        find_tuning_pairs(tmp_path)
