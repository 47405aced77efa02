import dataclasses

import numpy as np
import pytest

from gmmjax import DetectionConfig
from gmmjax.changes import Verdicts
from gmmjax.evaluation import Scores
from gmmjax.plotting import tuning_figure
from gmmjax.reporting import console
from gmmjax.tuning import TuningResult, TuningState, VerdictCourse, VerdictResult, VerdictState
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


def lines(ax):
    return {line.get_label(): line for line in ax.lines}


def test_the_chosen_draw_is_marked_among_those_that_were_tried(result):
    drawn = lines(tuning_figure(result).axes[0])
    losses, chosen = drawn["held back"], drawn["chosen"]
    assert list(losses.get_xdata()) == ["as it was", "30", "10"] and list(losses.get_ydata()) == [0.9, 0.4, 0.5]
    assert list(chosen.get_xdata()) == ["30"] and list(chosen.get_ydata()) == [0.4]


def test_the_weight_that_moved_most_is_on_top(result):
    for ax in tuning_figure(result).axes[1::2]:
        names = [label.get_text() for label in ax.get_yticklabels()]
        assert names[:2] == ["excess", "distance"] and ax.yaxis_inverted()
        tuned, before = ([bar.get_width() for bar in bars] for bars in ax.containers)
        assert (tuned[0], before[0]) == (4.0, 1.0)


def test_a_verdict_without_candidates_is_not_shown(result):
    alone = dataclasses.replace(result, poses_given=dataclasses.replace(result.poses_given, candidates=0))
    assert len(tuning_figure(result).axes) == 4 and len(tuning_figure(alone).axes) == 2


@pytest.mark.parametrize(("lowest", "scale"), [(0.9, "linear"), (0.05, "log")])
def test_every_axis_has_numbers_and_whole_steps(lowest, scale):
    """A logarithmic axis only where the losses span a decade; the second start had stopped before the last step."""
    losses = np.linspace(0.95, lowest, 24).reshape(4, 2, 3)
    losses[3, 1] = np.nan
    state = TuningState(np.zeros((2, 1)), (), np.array([True, False]), np.ones((4, 2, 1)), losses, np.full(3, 0.9))
    figure = tuning_figure(
        TuningResult(
            config=DetectionConfig(),
            improved=True,
            loss="f1",
            parameters=("tolerance",),
            tuned={"tolerance": 0.02},
            baseline=(0.95,) * 3,
            best=(lowest,) * 3,
            best_step=2,
            best_start=0,
            stopped="steps",
            training=("kitchen", "hall"),
            held_back=("attic",),
            state=state,
        )
    )
    first, second = figure.axes
    assert first.get_yscale() == scale and second.get_title() == "tolerance"
    figure.canvas.draw()
    assert all(tick == round(tick) for tick in second.get_xticks())
    assert figure.get_suptitle().startswith("Tuned: tolerance = 0.02\nloss ")
    assert list(lines(first)["chosen"].get_xdata()) == [2]


def test_the_terminal_shows_both_verdicts_and_what_detection_finds(result, tmp_path, capsys):
    console.print_tuning(result, tmp_path / "tuned.toml", tmp_path / "tuned.png")
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["log", "score,", "held", "back", "0.9", "0.4"] in lines
    assert ["weight", "of", "excess", "+1.00", "+4.00"] in lines
    assert ["false", "segments", "of", "detect,", "held", "back", "9", "0"] in lines
