import numpy as np
import pytest

from gmmjax.changes import DetectionConfig, names_of
from gmmjax.errors import InputError
from gmmjax.evaluation import LabelledCloud, LabelledPair
from gmmjax.learning import (
    CHANGED,
    LEARNED_FROM,
    UNCHANGED,
    UNOBSERVED,
    CandidateRows,
    collected,
    collection,
    read_rows,
    rows_of,
    training_sources,
)
from gmmjax.pair import Pair
from tests.changes.rooms import around, box, scanned


@pytest.fixture(scope="module")
def found():
    """A room where a box came; of the before survey a part of the views is lost."""
    views = Pair(around(5), around(8))
    thing = box((-0.4, -0.3, 0), (0.3, 0.3, 0.3))
    before = scanned(views.before, noise=0.004, voxel=0.016)
    after = scanned(views.after, [thing], noise=0.004, voxel=0.016, seed=1)
    inside = ((after > thing[0] - 0.01) & (after < thing[1] + 0.01)).all(axis=1)
    nothing = np.zeros(len(before), bool)
    unseen = after[:, 0] > 0.9
    pair = LabelledPair(
        "room",
        LabelledCloud(before, np.full(len(before), -1), nothing, views.before),
        LabelledCloud(after, np.where(inside, 0, -1), unseen & ~inside, views.after),
    )
    # Nothing is judged, so that no verdict is needed to learn one.
    return rows_of(pair, DetectionConfig(verdict="nowhere.json"))


@pytest.mark.slow
def test_the_box_is_a_change_in_both_sets(found):
    for rows in found:
        (largest,) = np.flatnonzero(rows.points == rows.points[rows.kind == CHANGED].max())[:1]
        assert rows.changed_points[largest] > 0.9 * rows.points[largest]
        assert set(rows.kind) <= {CHANGED, UNOBSERVED, UNCHANGED}
        assert rows.values.shape[0] == len(rows.kind) == len(rows.points)
    assert found.after.values.shape[1] > found.before.values.shape[1]


@pytest.fixture
def asked(found, monkeypatch):
    """The families that were collected; the first time that of the town is interrupted."""
    families = []

    def of_family(family, seeds, workers, progress):
        families.append(family)
        if family == "town" and families.count("town") == 1:
            raise KeyboardInterrupt
        return found, [f"{family}, seed 1: no"]

    monkeypatch.setattr(collection, "_of_family", of_family)
    return families


def test_an_interrupted_collection_goes_on_and_is_read_again(found, asked, tmp_path):
    families, folder = ["rooms", "town", "yards"], tmp_path / "rows"
    with pytest.raises(KeyboardInterrupt):
        collected(families, range(2), folder=folder)
    whole = collected(families, range(2), folder=folder)
    assert asked == ["rooms", "town", "town", "yards"]
    assert tuple(whole.families) == tuple(families) and whole.seeds == (0, 1)
    assert whole.failed == ("town, seed 1: no", "yards, seed 1: no")
    again = read_rows(folder)
    assert again.families.keys() == whole.families.keys() and again.seeds == whole.seeds
    for was, now in zip(found, again.families["town"], strict=True):
        for before, after in zip(was, now, strict=True):
            np.testing.assert_array_equal(before, after)
    with pytest.raises(InputError, match=r"rooms\.npz: was collected from other seeds; remove it"):
        collected(families, range(3), folder=folder)
    (folder / "yards.npz").unlink()
    collected(["yards"], [0], folder=folder)
    with pytest.raises(InputError, match="its families were collected from different seeds"):
        read_rows(folder)


def test_a_folder_without_candidates_and_one_that_cannot_be_made(tmp_path):
    with pytest.raises(InputError, match="has no candidates of a family"):
        read_rows(tmp_path)
    with pytest.raises(InputError, match="cannot make this folder"):
        collected(["rooms"], [0], folder=tmp_path / "nowhere" / "rows")


def test_candidates_of_other_facts_are_refused(tmp_path):
    np.savez(tmp_path / "rooms.npz", **{"names/before": np.array(["luck"]), "names/after": np.array(["luck"])})
    with pytest.raises(InputError, match=r"rooms\.npz: was made with other facts"):
        read_rows(tmp_path)


def test_every_family_has_scenes_with_views():
    for family in LEARNED_FROM:
        (source,) = training_sources(family, [7])
        assert source.name
    with pytest.raises(InputError, match="family='caves'"):
        training_sources("caves", [0])


@pytest.mark.slow
def test_the_number_of_workers_changes_nothing():
    one, two = (collected(["tabletop"], [2, 3], workers=workers) for workers in (1, 2))
    for was, now in zip(one.families["tabletop"], two.families["tabletop"], strict=True):
        np.testing.assert_array_equal(was.values, now.values)
        np.testing.assert_array_equal(was.kind, now.kind)


@pytest.mark.slow
def test_scenes_of_many_points_are_examined_at_their_own_resolution_too(monkeypatch):
    found = []
    for voxels in (0, 8_000, 10**6):
        monkeypatch.setattr(collection, "REGISTERED_VOXELS", voxels)
        found.append(collected(["terrain"], [1]).families["terrain"].before)
    alone, both, never = found
    assert 0 < len(alone.kind) < len(both.kind)
    np.testing.assert_array_equal(both.values[: len(alone.kind)], alone.values)
    np.testing.assert_array_equal(never.values, alone.values)
    assert (both.kind[len(alone.kind) :] == CHANGED).any()


def test_no_rows_have_the_columns_of_the_facts():
    for poses in (False, True):
        assert CandidateRows.none(poses=poses).values.shape == (0, len(names_of(poses=poses)))
