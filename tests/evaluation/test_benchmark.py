import csv
import dataclasses
import io
import json
import warnings

import numpy as np
import pytest

from gmmjax import InputError, InputWarning
from gmmjax.evaluation import Detection, LabelledCloud, LabelledPair, PairSource, evaluate
from gmmjax.evaluation.tables import HEADINGS, cells, sections, to_csv, to_json, to_markdown

POINTS = np.zeros((4, 3))
TRUTH = np.array([-1, -1, 0, 0])
NOTHING = np.full(4, -1)


def perfect(pair):
    return Detection(pair.before.truth, pair.after.truth)


def blind(pair):
    return Detection(NOTHING, NOTHING)


def nervous(pair):
    return Detection(np.arange(4), NOTHING)


def fragile(pair):
    if not pair.unchanged:
        raise ZeroDivisionError("no component left")
    return perfect(pair)


def pair(name, truth=TRUTH):
    return LabelledPair(name, LabelledCloud(POINTS, truth), LabelledCloud(POINTS, NOTHING))


def source(name, condition, truth=TRUTH, group="scenes"):
    return PairSource(name, group, condition, lambda: pair(name, truth))


def unreadable():
    raise InputError("b.npy: is missing")


SOURCES = [source("a", "gone"), source("b", "gone"), source("c", "none", NOTHING), source("d", "gone", group="others")]
DETECTORS = {"perfect": perfect, "blind": blind, "nervous": nervous}


@pytest.fixture(scope="module")
def evaluation():
    return evaluate(DETECTORS, SOURCES)


def row(rows, detector, condition, group="scenes"):
    (found,) = [row for row in rows if (row.detector, row.condition, row.group) == (detector, condition, group)]
    return found


def test_there_is_a_row_for_each_detector_and_condition(evaluation):
    assert len(evaluation.rows) == 3 * 3 and len(evaluation.totals) == 3 * 2
    assert row(evaluation.rows, "perfect", "gone").pairs == 2
    assert row(evaluation.rows, "perfect", "gone").scores.f1 == 1
    assert row(evaluation.rows, "blind", "gone").scores.recall == 0


def test_groups_are_summed_up_apart(evaluation):
    assert row(evaluation.totals, "blind", "all").scores.changes == 2
    assert row(evaluation.totals, "blind", "all", "others").scores.changes == 1


def test_false_segments_of_unchanged_pairs_are_counted(evaluation):
    scores = row(evaluation.rows, "nervous", "none").scores
    assert (scores.false_in_unchanged, scores.unchanged_pairs) == (4, 1)


def test_a_failure_does_not_lose_the_others():
    sources = [SOURCES[0], PairSource("b", "scenes", "gone", unreadable), SOURCES[2]]
    evaluation = evaluate({"fragile": fragile, "perfect": perfect}, sources)
    assert (row(evaluation.rows, "perfect", "gone").pairs, row(evaluation.rows, "perfect", "gone").failed) == (1, 1)
    assert (row(evaluation.rows, "fragile", "gone").pairs, row(evaluation.rows, "fragile", "gone").failed) == (0, 2)
    assert row(evaluation.rows, "fragile", "gone").seconds is None
    assert row(evaluation.rows, "fragile", "none").pairs == 1
    assert [str(failure) for failure in evaluation.failures] == [
        "gone, a, fragile: ZeroDivisionError: no component left",
        "gone, b: b.npy: is missing",
    ]


def test_progress_and_detections_are_told():
    told, recorded = [], []
    evaluate(
        DETECTORS,
        SOURCES[:2],
        progress=lambda stage, share: told.append((stage, share)),
        record=lambda name, pair, detection: recorded.append((name, pair.name)),
    )
    shares = [share for _, share in told]
    assert shares == sorted(shares) and 0 <= shares[0] and shares[-1] < 1
    assert "gone, b: nervous" in [stage for stage, _ in told]
    assert recorded == [(name, pair) for pair in "ab" for name in DETECTORS]


def test_warnings_say_what_they_are_about():
    def doubtful(pair):
        warnings.warn("the clouds hardly overlap", InputWarning, stacklevel=2)
        return perfect(pair)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        evaluate({"doubtful": doubtful}, SOURCES[:1])
    assert [str(warning.message) for warning in caught] == ["gone, a, doubtful: the clouds hardly overlap"]


def test_moved_objects_reach_the_scores():
    moved = LabelledPair("m", LabelledCloud(POINTS, TRUTH), LabelledCloud(POINTS, TRUTH[::-1].copy()))

    def detect(pair):
        return Detection(pair.before.truth, pair.after.truth, ((0, 0),))

    (found,) = evaluate({"it": detect}, [PairSource("m", "g", "c", lambda: moved)]).rows
    assert (found.scores.moved, found.scores.moved_found) == (1, 1)
    assert cells(found)[HEADINGS.index("moved")] == "1/1"


def test_tables_hold_every_row(evaluation):
    lines = to_markdown(evaluation).splitlines()
    assert len(lines) == 2 + 9 + 3
    assert sum(line.startswith("| all 2 of scenes |") for line in lines) == 3
    assert sum(line.startswith("| none |") for line in lines) == 3


def test_a_condition_of_two_groups_is_told_apart(evaluation):
    assert [heading for heading, _ in sections(evaluation)] == [
        "gone, scenes",
        "none",
        "all 2 of scenes",
        "gone, others",
    ]
    read = list(csv.DictReader(io.StringIO(to_csv(evaluation))))
    assert [line["detector"] for line in read[:3]] == list(DETECTORS)
    assert float(read[0]["f1"]) == 1 and read[0]["pairs"] == "2"
    content = json.loads(to_json(evaluation))
    assert len(content["rows"]) == 9 and len(content["totals"]) == 6 and content["failures"] == []
    assert content["rows"][0]["point_recall"] == 1


def test_what_failed_is_in_the_tables():
    evaluation = evaluate({"fragile": fragile}, [SOURCES[0], SOURCES[2]])
    assert "- failed: gone, a, fragile" in to_markdown(evaluation)
    content = json.loads(to_json(evaluation))
    assert content["rows"][0]["failed"] == 1 and content["rows"][0]["seconds"] is None
    assert len(content["failures"]) == 1
    (first,) = [cells(row) for row in evaluation.rows if row.condition == "gone"]
    assert first[HEADINGS.index("pairs")] == "0 (-1)" and first[HEADINGS.index("F1")] == ""


def test_rows_cannot_be_changed(evaluation):
    with pytest.raises(dataclasses.FrozenInstanceError):
        evaluation.rows[0].pairs = 3
