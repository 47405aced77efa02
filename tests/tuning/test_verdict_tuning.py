import dataclasses
import importlib
import json
import tomllib

import numpy as np
import pytest

from gmmjax import DetectionConfig, InputError, InputWarning
from gmmjax.changes import Verdicts, read_verdicts, write_verdicts
from gmmjax.cli import main
from gmmjax.clouds import write_ply
from gmmjax.evaluation import Scores
from gmmjax.learning import CHANGED, NOT_CHANGED, UNOBSERVED
from gmmjax.plotting import tuning_figure
from gmmjax.reporting.tuning_files import read_state, write_state, write_tuned
from gmmjax.tuning import ScanPair, TuningSettings, VerdictState, tune, tune_verdict, unchanged_pair
from tests.changes.evidence.verdicts import verdict
from tests.changes.rooms import around, box, scanned
from tests.tuning.candidates import DISTANT, measured_pairs, pairs_of
from tests.tuning.scenes import gaussian_pair

STEPS = importlib.import_module("gmmjax.tuning.verdict_tuning")
FOUND_LESS = Scores(
    true_segments=4, segments=8, found=4, changes=8, true_points=40, labelled_points=80, changed_points=80
)
FOUND_MORE = dataclasses.replace(FOUND_LESS, true_segments=8, found=8, true_points=80)

pytestmark = pytest.mark.usefixtures("no_compilation_cache")


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


@pytest.mark.slow
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
    result = tuned(config, measured_pairs(4), draws=(3.0,))
    assert not result.improved and np.isfinite(result.poses_unknown.draw)
    np.testing.assert_array_equal(
        result.verdicts.poses_unknown.weights, read_verdicts(config.verdict).poses_unknown.weights
    )


def test_a_gain_that_is_not_clear_is_none(config):
    # Nothing is detected: that would fail, the pairs have four points.
    result = tuned(config, measured_pairs(4), draws=(30.0,), min_corrected=1000)
    course = result.poses_unknown
    assert not result.improved and np.isinf(course.draw) and course.tuned is course.start
    # What was tried is told all the same.
    assert course.tried == 30.0 and course.wrong[1] < course.wrong[0]


@pytest.mark.parametrize(
    ("of_pairs", "clear"),
    [
        ((1, 1, 0, 1, 0, 1, 0, 0), False),
        ((1, 1, 1, 1, 1, 0, 0, 0), True),
        ((8, 0, 0, 0, 0, 0, 0, 0), False),
        ((3, -1, 2, 0, 2, 0, -1, 0), False),
        ((3, 2, 2, 0, 2, 1, 0, 1), True),
    ],
    ids=["too few", "five pairs", "one odd pair", "some are spoilt", "most pairs"],
)
def test_corrections_count_where_they_are_many_and_in_many_pairs(of_pairs, clear):
    gains = np.repeat(np.sign(of_pairs), np.abs(of_pairs))
    of_pair = np.repeat(np.arange(8), np.abs(of_pairs))
    still = np.arange(8)
    gains, of_pair = np.concatenate([gains, 0 * still]), np.concatenate([of_pair, still])
    assert STEPS._clearly_corrected(gains, of_pair, TuningSettings()) is clear


@pytest.mark.slow
def test_a_verdict_that_only_becomes_surer_stays(config, tmp_path):
    # Right about all, but unsure: the log score of the pairs held back falls by far, and nothing is judged otherwise.
    unsure = verdict({"count": 0.4}, bias=(-1.74, -9.0))
    write_verdicts(tmp_path / "unsure.json", Verdicts(unsure, verdict({}, poses=True)), {})
    result = tuned(DetectionConfig(verdict=str(tmp_path / "unsure.json")), measured_pairs(8))
    course = result.poses_unknown
    assert min(course.losses) < 0.5 * course.losses[0] and course.wrong[0] == 0
    assert not result.improved and np.isinf(course.draw) and np.isfinite(course.tried)


def test_a_gain_must_show_in_detection(config, detection):
    detection(FOUND_LESS, FOUND_LESS)
    result = tuned(config, measured_pairs(4), draws=(30.0,))
    assert result.poses_unknown.clear and not result.improved


def test_a_verdict_that_is_right_already_stays(config, tmp_path):
    right = verdict({"count": 40.0}, bias=(-174.0, 0.0))
    write_verdicts(tmp_path / "right.json", Verdicts(right, verdict({}, poses=True)), {})
    # Nothing is detected: that would fail, the pairs have four points.
    result = tuned(DetectionConfig(verdict=str(tmp_path / "right.json")), measured_pairs(6), draws=(30.0, 10.0))
    assert not result.improved and np.isinf(result.poses_unknown.draw) and result.before is None


@pytest.mark.slow
def test_chance_is_not_learned(config):
    random = np.random.default_rng(0)
    shuffled = tuple(
        dataclasses.replace(own, before=own.before._replace(kind=random.permutation(own.before.kind)))
        for own in measured_pairs(8)
    )
    coin = verdict({}, bias=(0.0, -9.0))
    result = STEPS._course(coin, [own.before for own in shuffled], np.arange(8), 0.5, TuningSettings())
    assert np.isinf(result.draw)


@pytest.mark.slow
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


@pytest.mark.parametrize(
    "change", [{"draws": ()}, {"draws": (1.0, -1.0)}, {"folds": 1}, {"clear_errors": -1.0}, {"min_corrected": 0}]
)
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
    write_tuned(tmp_path / "tuned.toml", result)
    assert tomllib.loads((tmp_path / "tuned.toml").read_text())["verdict"] == "tuned.verdict.json"
    written = read_verdicts(tmp_path / "tuned.verdict.json").poses_unknown.weights
    np.testing.assert_allclose(written, result.verdicts.poses_unknown.weights, rtol=1e-5)


def test_a_verdict_that_stays_is_not_written(config, tmp_path):
    result = tuned(config, measured_pairs(3, size=0))
    write_tuned(tmp_path / "tuned.toml", result)
    assert [path.name for path in tmp_path.iterdir()] == ["tuned.toml"]
    assert tuning_figure(result).get_suptitle().startswith("Verdict not better than before")
    assert tomllib.loads((tmp_path / "tuned.toml").read_text())["verdict"] == config.verdict


VIEWS = around(4)
ROOM = {"pixels": (64, 48), "noise": 0.003}
CRATE = box((0.3, 0.0, 0.0), (0.3, 0.3, 0.3))


@pytest.fixture(scope="module")
def room():
    """A room in which a box appears, with its truth."""
    before, after = scanned(VIEWS, **ROOM), scanned(VIEWS, [CRATE], seed=1, **ROOM)
    inside = ((after > CRATE[0] - 0.01) & (after < CRATE[1] + 0.01)).all(axis=1) & (after[:, 2] > 0.02)
    truth = np.full(len(before), -1), np.where(inside, 0, -1)
    return ScanPair("room", before, after, *truth, views_before=VIEWS, views_after=VIEWS)


def candidates_of(pair):
    """The candidates of a pair, without and with the other survey's views."""
    ((rows),) = STEPS._measured(
        [pair], DetectionConfig(), VerdictState(), lambda state: None, lambda stage, share: None
    ).measured
    return rows


@pytest.mark.slow
def test_candidates_are_what_the_truth_says(room):
    rows = candidates_of(room)
    # The views of both surveys are known, so that all candidates are judged with them.
    assert not len(rows.before.kind)
    assert CHANGED in set(rows.after.kind) and set(rows.after.kind) <= {CHANGED, NOT_CHANGED}


def test_without_views_it_is_the_other_verdict_that_is_tuned(room):
    hidden = np.ones(len(room.before), bool), np.ones(len(room.after), bool)
    blind = dataclasses.replace(
        unchanged_pair("room", room.before, room.after), unseen_before=hidden[0], unseen_after=hidden[1]
    )
    rows = candidates_of(blind)
    assert len(rows.before.kind) and not len(rows.after.kind)
    # What is said to be hidden is judged as not observed.
    assert set(rows.before.kind) == {UNOBSERVED}


def test_points_that_are_ignored_are_no_candidates(room):
    ignored = np.ones(len(room.before), bool), np.ones(len(room.after), bool)
    rows = candidates_of(dataclasses.replace(room, ignored_before=ignored[0], ignored_after=ignored[1]))
    assert not len(rows.after.kind)


def test_truth_that_does_not_fit_is_named(room, config):
    wrong = dataclasses.replace(room, truth_after=np.zeros(3, int))
    with pytest.raises(InputError, match=r"room: truth_after must hold whole numbers .* each of the \d+ points"):
        tune_verdict([wrong], config=config)


@pytest.fixture(scope="module")
def folder(room, tmp_path_factory):
    """An unchanged place surveyed twice, without truth, and a verdict by which all candidates are changes."""
    folder = tmp_path_factory.mktemp("folder")
    (folder / "pairs" / "room").mkdir(parents=True)
    for side in ("before", "after"):
        write_ply(folder / "pairs" / "room" / f"{side}.ply", getattr(room, side))
    every = [verdict({}, bias=(2.0, 0.0), poses=poses) for poses in (False, True)]
    write_verdicts(folder / "every.json", Verdicts(*every), {})
    (folder / "every.toml").write_text('verdict = "every.json"\nrestarts = 1\n')
    return folder


def run(folder, *more):
    return main(["tune", str(folder / "pairs"), "--config", str(folder / "every.toml"), *more])


@pytest.mark.slow
def test_an_unchanged_place_stops_false_alarms_and_detection_uses_the_file(folder, capsys, monkeypatch):
    out = folder / "tuned.toml"
    assert run(folder, "--out", str(out), "--unchanged", "--min-corrected", "1") == 0
    printed = capsys.readouterr()
    assert "Verdict tuned" in printed.out and "false segments of detect" in printed.out
    assert "1 pair is too few" in printed.err
    assert sorted(path.name for path in folder.glob("tuned*")) == ["tuned.png", "tuned.toml", "tuned.verdict.json"]
    # From another folder: the path in the settings is relative to them.
    monkeypatch.chdir(folder / "pairs")
    clouds = ["room/before.ply", "room/after.ply", "--quiet"]
    found = []
    for config in ("every", "tuned"):
        assert main(["detect", *clouds, "--out", str(folder / config), "--config", f"../{config}.toml"]) == 0
        found.append(len(json.loads((folder / config / "changes.json").read_text())["changes"]))
    assert found[0] > found[1] == 0
    used = tomllib.loads((folder / "tuned" / "config.toml").read_text())["verdict"]
    assert used == str(folder / "tuned.verdict.json")


@pytest.mark.slow
def test_goes_on_after_an_interruption(folder, tmp_path, monkeypatch, capsys):
    out = tmp_path / "later.toml"

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(STEPS, "_course", interrupted)
        assert run(folder, "--out", str(out), "--unchanged", "--draws", "1") == 130
    assert [path.name for path in tmp_path.iterdir()] == ["later.progress.npz"]
    capsys.readouterr()
    # The candidates are not measured again.
    monkeypatch.setattr(STEPS, "rows_of_scans", interrupted)
    assert run(folder, "--out", str(out), "--unchanged", "--draws", "1") == 0
    assert "Going on after pair 1" in capsys.readouterr().err and not list(tmp_path.glob("*.npz"))


def test_a_file_of_another_version_is_refused_before_the_work(folder, tmp_path, capsys):
    content = json.loads((folder / "every.json").read_text())
    (tmp_path / "old.json").write_text(json.dumps({**content, "schema_version": 99}))
    clouds = [str(folder / "pairs" / "room" / f"{side}.ply") for side in ("before", "after")]
    result = ["--out", str(tmp_path / "result"), "--verdict", str(tmp_path / "old.json")]
    assert main(["detect", *clouds, *result]) == 2
    assert "old.json: has schema version 99" in capsys.readouterr().err and not (tmp_path / "result").exists()
