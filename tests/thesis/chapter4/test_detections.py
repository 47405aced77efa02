import dataclasses
from collections import Counter

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.changes import DetectionConfig
from gmmjax.evaluation import Condition, Detection, gaussian_pair
from gmmjax.thesis.chapter4 import detections
from gmmjax.thesis.chapter4.accuracy import COUNTS
from gmmjax.thesis.chapter4.detections import condition_rows, filtered, kept, opposite_rows, published, survey_rows
from tests.thesis.chapter4.floors import floor_pair, floor_sources


def counts(*numbers, **more):
    return Counter(pairs=1, **dict(zip(COUNTS, numbers, strict=True)), **more)


PERFECT, BLIND = counts(1, 0, 1, 0, 3), counts(0, 1, 0, 1, 2)
NO_PROGRESS = lambda stage, share: None  # noqa: E731


def everything(pair, **told):
    """A detector that reports everything in both clouds."""
    return Detection(*(np.zeros(len(cloud.points), int) for cloud in (pair.before, pair.after)))


@pytest.fixture
def floors(monkeypatch):
    """A floor with a box in place of the laboratory, and a detector that computes nothing."""
    monkeypatch.setattr(detections, "lab_sources", floor_sources)
    monkeypatch.setattr(detections, "detector", lambda *arguments: everything)
    monkeypatch.setattr(detections, "published", everything)


@pytest.fixture(scope="module")
def found():
    """One of five Gaussians is gone, another one is new: what single runs report."""
    pair, config = gaussian_pair(Condition(1, 1, "low", points=200), 1), DetectionConfig(max_components=8)
    runs = {kinds: published(pair, kinds, config) for kinds in (("disappeared",), ("appeared",))}
    return pair, *runs.values(), published(pair, config=config)


@pytest.mark.slow
def test_the_published_algorithm_reports_what_it_is_told_to_look_for(found):
    pair, gone, new, _ = found
    assert (gone.labels_after == -1).all() and (new.labels_before == -1).all()
    assert (gone.labels_before[pair.before.truth >= 0] >= 0).mean() > 0.9
    assert (new.labels_after[pair.after.truth >= 0] >= 0).mean() > 0.9


def test_two_single_runs_do_not_see_what_the_other_one_removed(found):
    _, gone, new, both = found
    np.testing.assert_array_equal(both.labels_after, new.labels_after)
    np.testing.assert_array_equal(both.labels_before, gone.labels_before)


def test_one_kind_and_both_kinds_of_change_are_summed_up():
    numbers = {"(+1) low": PERFECT, "(-2) medium": BLIND, "(-1 +1) low": BLIND}
    rows = condition_rows("published", {(name, "published"): own for name, own in numbers.items()})
    by_condition = {row["condition"]: row for row in rows}
    assert by_condition["(+1) low"]["f1"] == 1 and by_condition["(+2) low"]["f1"] is None
    assert (by_condition["one kind"]["f1"], by_condition["one kind"]["pairs"]) == (0.5, 2)
    assert by_condition["one kind"]["accuracy"] == 0.75
    assert by_condition["both kinds"]["f1"] == 0


def test_the_published_algorithm_is_told_the_kinds_of_change(monkeypatch):
    told = {}

    def record(pair, kinds):
        told.setdefault(tuple(kinds), []).append(pair.name)
        return everything(pair)

    monkeypatch.setattr(detections, "published", record)
    monkeypatch.setattr(detections, "detector", lambda name: everything)
    (table,) = detections.gaussians([5, 6], NO_PROGRESS).tables
    assert {kinds: len(names) for kinds, names in told.items()} == {
        ("appeared",): 8,
        ("disappeared",): 8,
        ("appeared", "disappeared"): 4,
    }
    assert set(told["appeared",]) == {"seed 5", "seed 6"}
    assert [row["f1"] for row in table.brief if row["method"] == "thesis"] == [0.8, 0.52]
    assert len(table.rows) == 3 * (10 + 2) + 2 and len(table.figure.axes) == 3


def test_surveys_stand_beside_the_numbers_of_the_thesis():
    overlap = {"overlap true_positives": 1, "overlap found": 1, "overlap missed": 1}
    opposite = {"opposite false_positives": 1, "opposite true_negatives": 3}
    own = counts(1, 0, 1, 0, 3, **overlap, **opposite)
    found = {("single frames", "published"): own, ("single frames", "published, opposite"): own}
    rows = {(row["data"], row["method"]): row for row in survey_rows(found)}
    assert rows["single frames", "published"]["f1"] == 1 and rows["single frames", "thesis"]["f1"] == 0.7
    assert rows["single frames", "published"]["f1_by_overlap"] == pytest.approx(2 / 3, abs=1e-4)
    assert ("volumetric maps", "published") not in rows and rows["volumetric maps", "thesis"]["precision"] == 0.81
    rows = {(row["data"], row["method"]): row["accuracy"] for row in opposite_rows(found)}
    assert rows["single frames", "published"] == 0.75 and rows["localised maps", "thesis"] == 0.82


def test_what_happened_and_what_did_not_are_counted_apart(floors, monkeypatch):
    """With a detector that reports everything; what cannot be made here is left out and said."""

    def without_volumetric(seeds, kind):
        if kind == "volumetric":
            raise InputError("install open3d")
        return floor_sources(seeds, kind)

    monkeypatch.setattr(detections, "lab_sources", without_volumetric)
    part = detections.surveys([0, 1], NO_PROGRESS)
    assert part.notes == ("Left out: install open3d.",) and not part.failures
    measures, opposite = ({(row["data"], row["method"]): row for row in table.rows} for table in part.tables)
    # The box, one of a hundred points, in what is reported of its cloud.
    row = measures["localised maps", "joint"]
    assert (row["pairs"], row["false_positives"], row["missed"]) == (2, 4, 2)
    row = opposite["localised maps", "published"]
    assert (row["pairs"], row["false_positives"], row["accuracy"]) == (2, 2, 0)
    assert ("volumetric maps", "joint") not in measures


def test_the_filter_stands_beside_none(floors):
    (table,) = detections.filtering([0, 1], NO_PROGRESS).tables
    assert [(row["filters"], row["method"], row["pairs"]) for row in table.rows] == [
        ("voxel filter only", "joint", 2),
        ("voxel filter only", "published", 2),
        ("voxel and outlier filter", "joint", 2),
        ("voxel and outlier filter", "published", 2),
    ]
    assert [ax.get_title() for ax in table.figure.axes] == ["all points", "without outliers", "joint", "published"]


def test_outliers_are_taken_out_of_every_array_and_labelled_unchanged():
    pair = floor_pair(0)
    after = dataclasses.replace(
        pair.after,
        points=np.concatenate([pair.after.points, [[0.5, 0.5, 5.0]]]),
        truth=np.append(pair.after.truth, -1),
        things=np.append(pair.after.things, -1),
        unseen=np.append(pair.after.truth >= 0, True),
    )
    keep = kept(after)
    assert not keep[-1] and keep.mean() > 0.9
    seen = []

    def detect(pair):
        seen.append(pair)
        return everything(pair)

    found = filtered(detect, dataclasses.replace(pair, after=after))
    for name in ("points", "truth", "things", "unseen"):
        assert len(getattr(seen[0].after, name)) == keep.sum()
    np.testing.assert_array_equal(found.labels_after, np.where(keep, 0, -1))
