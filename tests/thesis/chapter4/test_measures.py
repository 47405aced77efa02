import dataclasses

import numpy as np
import pytest

from gmmjax.changes import DetectionConfig
from gmmjax.evaluation.gaussians import Condition, gaussian_pair
from gmmjax.thesis.chapter4 import Outcome
from gmmjax.thesis.chapter4.accuracy import Confusion
from gmmjax.thesis.chapter4.measures import as_text, measured, printed, published

CONFIG = DetectionConfig(max_components=8)


@pytest.fixture(scope="module")
def pair():
    """One of five Gaussians is gone, another one is new."""
    return gaussian_pair(Condition(1, 1, "low", points=200), 1)


def test_the_published_algorithm_reports_what_it_is_told_to_look_for(pair):
    gone, new = published(pair, ("disappeared",), CONFIG), published(pair, ("appeared",), CONFIG)
    assert (gone.labels_after == -1).all() and (new.labels_before == -1).all()
    assert (gone.labels_before[pair.before.truth >= 0] >= 0).mean() > 0.9
    assert (new.labels_after[pair.after.truth >= 0] >= 0).mean() > 0.9


def test_two_single_runs_do_not_see_what_the_other_one_removed(pair):
    both = published(pair, config=CONFIG)
    np.testing.assert_array_equal(both.labels_after, published(pair, ("appeared",), CONFIG).labels_after)
    np.testing.assert_array_equal(both.labels_before, published(pair, ("disappeared",), CONFIG).labels_before)


def test_measures_are_of_all_pairs_together():
    counts = [Confusion(1, 0, 1, 0, 4), Confusion(0, 1, 0, 1, 3)]
    outcomes = [Outcome("c", 0, "joint", {}, {"all": dataclasses.asdict(own)}) for own in counts]
    row = measured(outcomes)
    assert (row["pairs"], row["precision"], row["recall"], row["f1"]) == (2, 0.5, 0.5, 0.5)
    assert row["accuracy"] == 0.8
    assert as_text(row) == "0.50"


def test_what_is_not_known_is_none():
    nothing = measured([])
    assert nothing["pairs"] == 0 and nothing["accuracy"] is None and as_text(nothing) == "–"
    assert printed(f1=0.8)["f1"] == 0.8 and printed(f1=0.8)["recall"] is None
    assert list(printed()) == list(nothing)
