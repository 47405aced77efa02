"""That the table of families left out says what was found, resumes, and runs another checkout on the same pairs."""

import dataclasses

import numpy as np
import pytest

from gmmjax.changes import Scan
from gmmjax.clouds import SensorViews
from gmmjax.evaluation import Detection, LabelledCloud, LabelledPair, PairSource, Scores
from gmmjax.pair import Pair
from tests.benchmarks import best_peers
from tests.benchmarks.left_out import __main__, jobs
from tests.benchmarks.left_out.jobs import FamilyResult, Job
from tests.benchmarks.left_out.other_checkout import found_there
from tests.benchmarks.left_out.table import to_markdown
from tests.evaluation.scenes import floor_with_box

GOOD = Scores(true_segments=4, segments=4, found=4, changes=4, true_points=9, labelled_points=10, changed_points=10)
FALSE = dataclasses.replace(GOOD, segments=8, unchanged_pairs=1, false_in_unchanged=4)
OTHER_VERSION = """
class InputError(Exception): pass
class ComputationError(Exception): pass
class InputWarning(UserWarning): pass
class SensorViews:
    def __init__(self, poses, angles, longest):
        self.longest = longest
class Changes: pass
def detect_changes(before, after, *, views_before=None, views_after=None):
    if len(after) == 1:
        raise InputError("one point is too few")
    found = Changes()
    limit = views_after.longest if views_after else 0
    found.labels_before, found.labels_after = [(cloud[:, 0] > limit).astype(int) - 1 for cloud in (before, after)]
    return found
"""


def pair_of(name, changed=True, points=3):
    """Points along a line, of which the last one changed; a sensor that sees two metres far."""
    line = np.arange(points)[:, None] * np.array([1.0, 0.0, 0.0])
    truth = np.full(points, -1)
    truth[-1] = 0 if changed else -1
    views = SensorViews(np.eye(4)[None], (60.0, 40.0), 1.5)
    before, after = (LabelledCloud(line, own, views=views) for own in (np.full(points, -1), truth))
    return LabelledPair(name, before, after)


@pytest.fixture
def job(tmp_path):
    (tmp_path / "halls.json").write_text("{}")
    return Job("halls", tmp_path / "halls.json", changed=2, unchanged=1, first_seed=0, against=None, peers=True)


def test_every_setting_is_what_the_peer_finds_alone():
    before, after, truth = floor_with_box()
    scans = Pair(Scan(before), Scan(after))
    pair = LabelledPair("box", LabelledCloud(before, np.full(len(before), -1)), LabelledCloud(after, truth))
    nothing = {"evidence": lambda labels: labels.map(lambda own: np.full_like(own, -1))}
    scored = {(name, text): scores for name, text, scores in best_peers.peer_scores(pair, scans, nothing)}
    for name, peers in best_peers.series():
        text, peer = list(peers.items())[-1]
        found = peer.detect(scans)
        assert scored[name, text].labelled_points == (found.labels_before >= 0).sum() + (found.labels_after >= 0).sum()
        assert scored[f"{name}+evidence", text].segments == 0
    assert max(scores.f1 for scores in scored.values()) == 1.0


def test_the_best_setting_of_a_peer_stands_beside_the_verdict():
    settings = {"near": FALSE, "far": GOOD}
    scores = {f"{name}, poses {poses}": {"": FALSE} for name in ("verdict", "other checkout") for poses in jobs.POSES}
    text = to_markdown([FamilyResult("halls", {"seed 0": {**scores, "c2c": settings}}, ["halls, seed 5: no scene"])])
    assert "| halls | 0.67 / 0.90, 4 | 0.67 / 0.90, 4 | 1.00 / 0.90, 0 |" in text
    assert "- halls: c2c finds 4 of 4, 0 false (1.00 / 0.90); the verdict finds 4 of 4, 4 false (0.67 / 0.90)" in text
    assert "| halls | far |" in text and "- failed: halls, seed 5: no scene" in text


def test_a_peer_is_told_at_one_setting_for_all_families_too():
    verdict = {f"{name}, poses {poses}": {"": GOOD} for name in ("verdict", "other checkout") for poses in jobs.POSES}
    of_families = {
        "halls": {"near": FALSE, "far": GOOD},
        "doors": {"near": GOOD, "far": dataclasses.replace(GOOD, found=0)},
    }
    found = [FamilyResult(name, {"": {**verdict, "c2c": own}}, []) for name, own in of_families.items()]
    text = to_markdown(found)
    assert "- c2c at one setting for all families (near): finds 8 of 8, 4 false (0.80 / 0.90)" in text


def test_a_family_is_not_computed_again_while_its_verdict_is_the_same(job, tmp_path):
    found, out = FamilyResult("halls", {"seed 0": {"c2c": {"near": GOOD}}}, []), tmp_path / "out"
    out.mkdir()
    jobs.keep(job, found, out)
    assert jobs.results([job], out, workers=1) == [found]
    assert jobs.kept(job._replace(changed=3), out) is None
    job.verdict.write_text("{ }")
    assert jobs.kept(job, out) is None


def test_pairs_are_drawn_until_there_are_enough_of_each(job, monkeypatch):
    def sources(family, seeds):
        (seed,) = seeds
        return [PairSource(f"seed {seed}", "", "", lambda: pair_of("line", changed=seed != 20))]

    monkeypatch.setattr(jobs, "training_sources", sources)
    assert [name for name, _ in jobs.loaded(job)] == ["seed 0", "seed 5", "seed 20"]


@pytest.fixture
def checkout(tmp_path):
    (tmp_path / "other" / "gmmjax").mkdir(parents=True)
    (tmp_path / "other" / "gmmjax" / "__init__.py").write_text(OTHER_VERSION)
    return tmp_path / "other"


def test_another_checkout_detects_with_poses_and_without(checkout):
    found = found_there(checkout, {"line": pair_of("line"), "point": pair_of("point", points=1)})
    assert found["point"] == "one point is too few"
    np.testing.assert_array_equal(found["line"]["unknown"].after, [-1, 0, 0])
    np.testing.assert_array_equal(found["line"]["given"].after, [-1, -1, 0])


def test_a_checkout_whose_gmmjax_is_not_used_is_refused(checkout, tmp_path):
    (tmp_path / "empty").mkdir()
    (checkout / "gmmjax").rename(tmp_path / "gmmjax")
    with pytest.raises(RuntimeError, match="empty: "):
        found_there(tmp_path / "empty", {"line": pair_of("line")})


def test_what_is_found_there_is_scored(job, monkeypatch, checkout):
    monkeypatch.setattr(jobs, "loaded", lambda job: [("seed 0", pair_of("line")), ("seed 5", pair_of("p", points=1))])
    nothing = Detection(np.full(3, -1), np.full(3, -1))
    monkeypatch.setattr(jobs, "detector", lambda name, config: lambda pair: nothing)
    found = jobs.result(job._replace(against=checkout, peers=False))
    assert found.pairs["seed 0"]["other checkout, poses given"][""].f1 == pytest.approx(2 / 3)
    assert found.pairs["seed 0"]["verdict, poses given"][""].found == 0
    assert list(found.pairs) == ["seed 0"] and "one point is too few" in found.failures[0]


def test_the_command_writes_the_table(job, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    made = {f"verdict, poses {poses}": {"": GOOD} for poses in jobs.POSES}
    monkeypatch.setattr(
        __main__, "results", lambda asked, folder, workers: [FamilyResult(own.family, {"": made}, []) for own in asked]
    )
    options = ["--verdicts", str(tmp_path), "--out", str(out), "--families", "halls"]
    monkeypatch.setattr("sys.argv", ["left_out", *options])
    __main__.main()
    assert "| halls | 1.00 / 0.90, 0 |" in (out / "table.md").read_text()
    assert (out / "table.md").read_text() in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--families doors", "has no doors.json"),
        ("--families halls --against nowhere", "nowhere: has no gmmjax"),
        ("--families halls --changed 0", "--changed and --workers"),
        ("--families halls --out .", "is the folder of the verdicts"),
    ],
)
def test_the_command_refuses_before_it_starts(job, tmp_path, monkeypatch, capsys, options, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["left_out", "--verdicts", str(tmp_path), "--out", "out", *options.split()])
    with pytest.raises(SystemExit):
        __main__.main()
    assert message in capsys.readouterr().err
