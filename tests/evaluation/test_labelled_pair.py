import numpy as np
import pytest

from gmmjax import InputError, SensorViews
from gmmjax.clouds import write_ply, write_views
from gmmjax.evaluation import find_pairs, read_pair

CLOUD = np.random.default_rng(0).uniform(1, 2, (20, 3))
TRUTH = np.repeat([-1, 3], 10)


@pytest.fixture
def folder(tmp_path):
    """A folder with one pair."""
    pair = tmp_path / "pairs" / "table"
    pair.mkdir(parents=True)
    np.save(pair / "before.npy", np.insert(CLOUD, 4, np.nan, axis=0))
    np.save(pair / "truth_before.npy", np.insert(TRUTH, 4, 99))
    write_ply(pair / "after.ply", CLOUD)
    np.save(pair / "truth_after.npy", np.full(20, -1, np.int8))
    return tmp_path / "pairs"


def test_a_pair_is_read_when_it_is_needed(folder):
    (source,) = find_pairs(folder)
    assert (source.name, source.group, source.condition, source.label) == ("table", "pairs", "table", "table")
    pair = source.load()
    assert len(pair.before.points) == len(pair.after.points) == 20
    assert pair.before.views is pair.before.unseen is None
    assert not pair.unchanged


def test_truth_belongs_to_the_rows_of_the_file(folder):
    """The fifth row has no position; its truth goes with it."""
    np.testing.assert_array_equal(read_pair(folder / "table").before.truth, TRUTH)


def test_what_else_is_known_is_read_too(folder):
    pair = folder / "table"
    np.save(pair / "unseen_before.npy", np.insert(TRUTH == 3, 4, False))
    views = SensorViews.at_origin(CLOUD)
    write_views(pair / "views_after.json", views)
    read = read_pair(pair)
    np.testing.assert_array_equal(read.before.unseen, TRUTH == 3)
    np.testing.assert_array_equal(read.after.views.poses, views.poses)


def test_changes_that_nobody_can_be_asked_to_find(folder):
    pair = folder / "table"
    np.save(pair / "not_counted_before.npy", np.array([3]))
    assert read_pair(pair).before.not_counted == {3}
    assert read_pair(pair).after.not_counted == frozenset()
    np.save(pair / "not_counted_before.npy", np.array([0.5]))
    with pytest.raises(InputError, match=r"not_counted_before.npy: must hold the ids of changes as whole numbers"):
        read_pair(pair)


def test_folders_without_any_of_it_are_passed_over(folder):
    (folder / "notes").mkdir()
    (folder / "notes" / "README.md").write_text("nothing")
    assert len(find_pairs(folder)) == 1


def add(name, content):
    return lambda pair: np.save(pair / name, content)


BROKEN = {
    "no truth": (lambda pair: (pair / "truth_after.npy").unlink(), "truth_after.npy: is missing"),
    "one cloud": (lambda pair: (pair / "after.ply").unlink(), "table: has no after.ply"),
    "two clouds": (add("after.npy", CLOUD), "several clouds after.npy, after.ply"),
    "short truth": (add("truth_after.npy", TRUTH[:-1]), "each of the 20 rows of after.ply"),
    "truth of the points": (add("truth_before.npy", TRUTH), "each of the 21 rows of before.npy"),
    "truth in decimals": (add("truth_after.npy", TRUTH / 2), "whole numbers"),
    "unseen in numbers": (add("unseen_after.npy", TRUTH), "true or false"),
    "damaged": (lambda pair: (pair / "truth_after.npy").write_bytes(b"garbage"), "numpy.save"),
    "pickled": (add("truth_after.npy", np.array([{}] * 20)), "numpy.save"),
    "views": (lambda pair: (pair / "views_after.json").write_text("{}"), "views_after.json: has no poses"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_bad_pairs_are_named(folder, name):
    spoil, message = BROKEN[name]
    spoil(folder / "table")
    with pytest.raises(InputError, match=message):
        for source in find_pairs(folder):
            source.load()


def test_bad_folders_are_named(folder, tmp_path):
    with pytest.raises(InputError, match=r"nowhere: there is no such folder"):
        find_pairs(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"table: holds no pairs; it is a pair itself"):
        find_pairs(folder / "table")
    with pytest.raises(InputError, match=r"holds no pairs; each pair is a folder"):
        find_pairs(tmp_path)
