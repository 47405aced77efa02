import dataclasses
import importlib
import json
import tomllib

import numpy as np
import pytest

from gmmjax import DetectionConfig, InputError, InputWarning
from gmmjax.changes import Verdicts, read_verdicts, write_verdicts
from gmmjax.evaluation import Scores
from gmmjax.learning import CHANGED, NOT_CHANGED
from gmmjax.reporting.tuning_files import read_state, write_state, write_tuned
from gmmjax.tuning import ScanPair, TuningSettings, VerdictState, tune, tune_verdict
from tests.changes.evidence.verdicts import verdict
from tests.changes.rooms import around, box, scanned
from tests.tuning.candidates import DISTANT, measured_pairs, pairs_of
from tests.tuning.scenes import gaussian_pair

STEPS = importlib.import_module("gmmjax.tuning.verdict_tuning")
FOUND_LESS = Scores(
    true_segments=4, segments=8, found=4, changes=8, true_points=40, labelled_points=80, changed_points=80
)
FOUND_MORE = dataclasses.replace(FOUND_LESS, true_segments=8, found=8, true_points=80)


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """With the verdict that takes flying pixels for changes."""
    path = tmp_path_factory.mktemp("verdict") / "distant.json"
    write_verdicts(path, Verdicts(DISTANT, verdict({"seen_free": 3.0}, poses=True)), {})
    return DetectionConfig(verdict=str(path))


@pytest.fixture
def detection(monkeypatch):
    """The scores that detection is said to have, before and after; what it was asked is kept."""

    def says(before, after):
        scores, asked = iter([before, after]), []

        def score(pairs, configs, progress):
            asked.append([read_verdicts(own.verdict) for own in configs])
            return next(scores)

        monkeypatch.setattr(STEPS, "detection_scores", score)
        return asked

    return says


def tuned(config, measured, **settings):
    """The result for candidates that were measured before."""
    pairs = pairs_of(len(measured))
    return tune_verdict(pairs, config=config, settings=TuningSettings(**settings), resume=VerdictState(measured))


def test_pairs_held_back_are_judged_better_and_only_the_verdict_without_poses_moves(config, detection):
    detection(FOUND_LESS, FOUND_MORE)
    result = tuned(config, measured_pairs(6))
    course = result.poses_unknown
    assert result.improved and np.isfinite(course.draw) and course.candidates == 48 and course.changes == 24
    assert course.losses[course.chosen] < 0.5 * course.losses[0]
    assert course.false_alarms[course.chosen] < 0.2 * course.false_alarms[0]
    assert {"thickness", "count"} & {name for name, _, _ in course.moved_weights()[:3]}
    given = read_verdicts(config.verdict)
    np.testing.assert_array_equal(result.verdicts.poses_given.weights, given.poses_given.weights)
    assert json.loads(json.dumps(result.to_dict(), allow_nan=False))["poses_unknown"]["draws"][0] is None


def test_detection_judges_each_pair_by_what_was_tuned_without_it(config, detection):
    asked = detection(FOUND_LESS, FOUND_MORE)
    measured = measured_pairs(4)
    tuned(config, measured, draws=(3.0,))
    before, after = asked
    assert all((own.poses_unknown.weights == before[0].poses_unknown.weights).all() for own in before)
    detection(FOUND_LESS, FOUND_MORE)
    others = tuned(config, measured[1:], draws=(3.0,))
    np.testing.assert_allclose(after[0].poses_unknown.weights, others.poses_unknown.tuned.weights, atol=1e-3)


@pytest.mark.parametrize(
    "after", [dataclasses.replace(FOUND_LESS, true_segments=3), dataclasses.replace(FOUND_MORE, true_points=30)]
)
def test_what_detection_finds_less_by_is_not_kept(config, detection, after):
    detection(FOUND_LESS, after)
    result = tuned(config, measured_pairs(6))
    assert not result.improved and np.isfinite(result.poses_unknown.draw)
    np.testing.assert_array_equal(
        result.verdicts.poses_unknown.weights, read_verdicts(config.verdict).poses_unknown.weights
    )


def test_a_verdict_that_is_right_already_stays(config, tmp_path):
    right = verdict({"count": 40.0}, bias=(-174.0, 0.0))
    write_verdicts(tmp_path / "right.json", Verdicts(right, verdict({}, poses=True)), {})
    # Nothing is detected: that would fail, the pairs have four points.
    result = tuned(DetectionConfig(verdict=str(tmp_path / "right.json")), measured_pairs(6), draws=(30.0, 10.0))
    assert not result.improved and np.isinf(result.poses_unknown.draw) and result.before is None


def test_chance_is_not_learned(config):
    random = np.random.default_rng(0)
    shuffled = tuple(
        dataclasses.replace(own, before=own.before._replace(kind=random.permutation(own.before.kind)))
        for own in measured_pairs(8)
    )
    coin = verdict({}, bias=(0.0, -9.0))
    result = STEPS._course(coin, [own.before for own in shuffled], np.arange(8), 0.5, TuningSettings())
    assert np.isinf(result.draw)


@pytest.mark.parametrize(("after", "improved"), [(2, True), (5, False)])
def test_unchanged_pairs_are_judged_by_their_false_segments(config, detection, after, improved):
    detection(Scores(segments=5, unchanged_pairs=4), Scores(segments=after, unchanged_pairs=4))
    result = tuned(config, measured_pairs(4, changes=0.0))
    course = result.poses_unknown
    assert result.improved is improved
    # The strongest draw that does: as little as possible is changed.
    least = min(course.false_alarms)
    assert course.false_alarms[course.chosen] == least and min(course.false_alarms[: course.chosen]) > least


def test_without_candidates_there_is_nothing_to_tune(config):
    result = tuned(config, measured_pairs(3, size=0))
    assert not result.improved and result.courses == {}


def test_a_single_pair_is_too_few(config, detection):
    detection(FOUND_LESS, FOUND_MORE)
    with pytest.warns(InputWarning, match="1 pair is too few to hold one back"):
        assert tuned(config, measured_pairs(1, size=40)).improved


def test_pairs_without_truth_are_named():
    with pytest.raises(InputError, match=r"seed 1: have no truth, .* --unchanged"):
        tune([gaussian_pair(1, labelled=False)], settings=TuningSettings(parameters=("verdict",)))


@pytest.mark.parametrize(
    ("parameters", "config", "message"),
    [
        (("verdict", "tolerance"), DetectionConfig(), "the verdict is tuned alone"),
        (("verdict",), DetectionConfig(evidence=False), "the verdict decides only with"),
        (("verdict",), DetectionConfig(method="greedy"), "the verdict decides only with"),
        (("verdict",), DetectionConfig(verdict="missing.json"), r"missing.json"),
    ],
)
def test_says_where_the_verdict_cannot_be_tuned(parameters, config, message):
    with pytest.raises(InputError, match=message):
        tune(pairs_of(3), config=config, settings=TuningSettings(parameters=parameters))


@pytest.mark.parametrize("change", [{"draws": ()}, {"draws": (1.0, -1.0)}, {"folds": 1}])
def test_settings_out_of_their_range_are_named(change):
    with pytest.raises(InputError, match=next(iter(change))):
        TuningSettings(**change)


def test_the_measured_candidates_come_back_as_they_were(tmp_path):
    state = VerdictState(measured_pairs(2))
    write_state(tmp_path / "state.npz", state, "these pairs")
    again = read_state(tmp_path / "state.npz", "these pairs")
    for own, other in zip(again.measured, state.measured, strict=True):
        for back, was in zip([*own.before, *own.after], [*other.before, *other.after], strict=True):
            np.testing.assert_array_equal(back, was)


def test_damaged_candidates_are_named(tmp_path):
    state = VerdictState(measured_pairs(2))
    rows = state.measured[0].before
    wrong = dataclasses.replace(state.measured[0], before=rows._replace(values=rows.values[:, 1:]))
    write_state(tmp_path / "state.npz", VerdictState((wrong,)), "these pairs")
    with pytest.raises(InputError, match=r"state.npz: is damaged \(its arrays do not fit each other\); .*--restart"):
        read_state(tmp_path / "state.npz", "these pairs")


def test_a_tuned_verdict_lies_beside_its_settings(config, detection, tmp_path):
    detection(FOUND_LESS, FOUND_MORE)
    result = tuned(config, measured_pairs(4), draws=(3.0,))
    page = write_tuned(tmp_path / "tuned.toml", result)
    assert tomllib.loads((tmp_path / "tuned.toml").read_text())["verdict"] == "tuned.verdict.json"
    written = read_verdicts(tmp_path / "tuned.verdict.json").poses_unknown.weights
    np.testing.assert_allclose(written, result.verdicts.poses_unknown.weights, rtol=1e-5)
    text = page.read_text()
    assert "Verdict tuned" in text and "thickness" in text and "<script src=" not in text


def test_a_verdict_that_stays_is_not_written(config, tmp_path):
    write_tuned(tmp_path / "tuned.toml", tuned(config, measured_pairs(3, size=0)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tuned.html", "tuned.toml"]
    assert tomllib.loads((tmp_path / "tuned.toml").read_text())["verdict"] == config.verdict


VIEWS = around(4)
ROOM = {"pixels": (64, 48), "noise": 0.003}
CRATE = box((0.3, 0.0, 0.0), (0.3, 0.3, 0.3))


def room_pair(*, known=True, unseen=False):
    """A room in which a box appears; `known`: with its truth."""
    before, after = scanned(VIEWS, **ROOM), scanned(VIEWS, [CRATE], seed=1, **ROOM)
    inside = ((after > CRATE[0] - 0.01) & (after < CRATE[1] + 0.01)).all(axis=1) & (after[:, 2] > 0.02)
    truth = (np.full(len(before), -1), np.where(inside, 0, -1)) if known else (None, None)
    pair = ScanPair("room", before, after, *truth, views_before=VIEWS, views_after=VIEWS)
    hidden = np.ones(len(before), bool), np.zeros(len(after), bool)
    return dataclasses.replace(pair, unseen_before=hidden[0], unseen_after=hidden[1]) if unseen else pair


def test_candidates_are_what_the_truth_says_and_measured_as_detection_does(config):
    states = []
    STEPS._measured([room_pair()], config, VerdictState(), states.append, lambda stage, share: None)
    ((rows,),) = (state.measured for state in states)
    # The views of both surveys are known, so that all candidates are judged with them.
    assert not len(rows.before.kind)
    kinds = set(rows.after.kind)
    assert CHANGED in kinds and kinds <= {CHANGED, NOT_CHANGED}


def test_truth_that_does_not_fit_is_named(config):
    wrong = dataclasses.replace(room_pair(), truth_after=np.zeros(3, int))
    with pytest.raises(InputError, match=r"room: truth_after must hold whole numbers .* each of the \d+ points"):
        tune_verdict([wrong], config=config)
