import dataclasses

import numpy as np
import pytest

from gmmjax import DetectionConfig
from gmmjax.changes import Verdicts
from gmmjax.evaluation import Scores
from gmmjax.reporting import console
from gmmjax.reporting.verdict_plot import verdict_html
from gmmjax.tuning import VerdictCourse, VerdictResult, VerdictState
from tests.changes.evidence.verdicts import verdict


def course(*, poses, draw=30.0):
    start = verdict({"distance": 2.0, "excess": 1.0}, poses=poses)
    tuned = verdict({"distance": 1.5, "excess": 4.0}, poses=poses)
    losses, false_alarms, wrong = (0.9, 0.4, 0.5), (7, 2, 3), (9, 3, 5)
    draws = (np.inf, 30.0, 10.0)
    return VerdictCourse(20, 8, draws, losses, false_alarms, wrong, draw, True, start, tuned, (tuned,))


@pytest.fixture
def result():
    courses = course(poses=False), course(poses=True)
    scores = Scores(segments=9, changes=8), Scores(true_segments=8, segments=8, found=8, changes=8)
    verdicts = Verdicts(*(own.tuned for own in courses))
    return VerdictResult(DetectionConfig(), True, verdicts, *courses, ("hall", "attic"), *scores, VerdictState())


@pytest.fixture
def figure(monkeypatch):
    shown = []
    monkeypatch.setattr("plotly.graph_objects.Figure.to_html", lambda self, **_: shown.append(self) or "")

    def of(result):
        verdict_html(result)
        return shown[-1]

    return of


def test_the_chosen_draw_is_marked_among_those_that_were_tried(result, figure):
    losses, chosen = (
        next(figure(result).select_traces({"name": name}, row=1, col=1)) for name in ("held back", "chosen")
    )
    assert list(losses.x) == ["as it was", "30", "10"] and list(losses.y) == [0.9, 0.4, 0.5]
    assert list(chosen.x) == ["30"] and list(chosen.y) == [0.4]


def test_the_weight_that_moved_most_is_on_top(result, figure):
    for row in (1, 2):
        tuned, before = (
            next(figure(result).select_traces({"name": name}, row=row, col=2)) for name in ("tuned", "before")
        )
        assert tuned.y[-1] == "excess" and tuned.x[-1] == 4.0 and before.x[-1] == 1.0
        assert tuned.y[-2] == "distance"


def test_a_verdict_without_candidates_is_not_shown(result, figure):
    alone = dataclasses.replace(result, poses_given=dataclasses.replace(result.poses_given, candidates=0))
    assert not list(figure(alone).select_traces({"xaxis": "x3"}))


def test_the_terminal_shows_both_verdicts_and_what_detection_finds(result, tmp_path, capsys):
    console.print_tuning(result, tmp_path / "tuned.toml", tmp_path / "tuned.html")
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["log", "score,", "held", "back", "0.9", "0.4"] in lines
    assert ["weight", "of", "excess", "+1.00", "+4.00"] in lines
    assert ["false", "segments", "of", "detect,", "held", "back", "9", "0"] in lines
