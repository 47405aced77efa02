import pytest

from gmmjax.evaluation import Evaluation, Failure, Row, Scores
from gmmjax.reporting import console
from gmmjax.reporting.console import evaluation_lines


def row(detector, condition, scores, seconds=1.5, failed=0):
    return Row(detector, "scenes", condition, 2, failed, scores, seconds)


FOUND = Scores(true_segments=3, segments=4, found=3, changes=3, true_points=9, labelled_points=10, changed_points=12)
NONE = Scores(segments=1, unchanged_pairs=2, false_in_unchanged=1)
MOVED = Scores(moved=3, moved_found=2, moved_false=1)


@pytest.fixture
def evaluation():
    conditions = {"(+1) low": FOUND, "(none)": NONE}
    rows = [
        row(name, condition, scores)
        for condition, scores in conditions.items()
        for name in ("joint", "transport+evidence")
    ]
    return Evaluation(
        tuple(rows), (row("joint", "all", FOUND + NONE), row("transport+evidence", "all", FOUND + NONE)), ()
    )


@pytest.mark.parametrize("width", [80, 120])
def test_the_table_fits_the_terminal(evaluation, width):
    lines = [text for text, _ in evaluation_lines(evaluation, width)]
    assert max(map(len, lines)) <= width
    assert ("pt pr." in lines[0]) == (width == 120)


def test_detectors_stand_under_their_condition(evaluation):
    lines = [text for text, _ in evaluation_lines(evaluation, 120)]
    assert lines[1] == "(+1) low"
    assert lines[2].split() == ["joint", "2", "0.750", "1.000", "0.857", "0.900", "0.750", "0.818", "1.50"]
    assert lines[4] == "(none)" and lines[5].split()[-2] == "1/2"
    assert lines[7] == "all 2 of scenes"


def test_columns_without_a_figure_are_left_out(evaluation):
    assert "moved" not in evaluation_lines(evaluation, 120)[0][0]
    lines = evaluation_lines(Evaluation((row("joint", "moved", MOVED),), (), ()), 120)
    assert "moved" in lines[0][0] and "2/3 +1" in lines[2][0] and "false" not in lines[0][0]


def test_pairs_that_failed_are_counted():
    assert "2 (-1)" in evaluation_lines(Evaluation((row("joint", "a", FOUND, failed=1),), (), ()), 120)[2][0]


def test_every_heading_that_needs_it_is_explained(evaluation):
    lines = [text for text, _ in evaluation_lines(evaluation, 80)]
    assert [line.split(":")[0] for line in lines[-3:]] == ["pt F1", "false", "s"]


def test_failures_of_one_reason_are_one_line(capsys):
    failures = [Failure(f"seed {seed}", "m3c2", "no\n  normals") for seed in range(3)]
    console.print_failures([*failures, Failure("b", None, "b: is missing")])
    captured = capsys.readouterr()
    assert captured.err.splitlines() == [
        "gmmjax: failed: m3c2 on seed 0 and 2 more: no normals",
        "gmmjax: failed: b: b: is missing",
    ]
    assert not captured.out
