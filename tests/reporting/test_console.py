import dataclasses
import json
import warnings

import pytest

from gmmjax.errors import InputWarning
from gmmjax.reporting import console
from tests.changes.explained import displaced


def test_the_table_fits_the_usual_terminal(pair, capsys):
    console.print_changes(pair[2])
    printed = capsys.readouterr().out
    assert printed.startswith("3 changes: 1 appeared, 1 disappeared, 1 moved\n")
    assert all(kind in printed for kind in ("appeared", "disappeared", "moved"))
    assert "…" not in printed
    assert "1 row of the before cloud" in printed


@pytest.mark.parametrize(
    ("width", "columns"),
    [
        ("80", ["Label", "Kind", "Prob.", "Points", "Centre", "Size", "Volume"]),
        ("72", ["Label", "Kind", "Prob.", "Centre", "Size", "Volume"]),
        ("60", ["Label", "Kind", "Prob.", "Centre", "Volume"]),
        ("35", ["Label", "Kind", "Prob."]),
    ],
)
def test_columns_that_do_not_fit_are_left_out(pair, capsys, monkeypatch, width, columns):
    monkeypatch.setenv("COLUMNS", width)
    items = tuple(dataclasses.replace(item, volume=123456.0) for item in pair[2].items)
    console.print_changes(dataclasses.replace(pair[2], items=items))
    lines = capsys.readouterr().out.splitlines()
    heading = next(line for line in lines if "Label" in line)
    assert heading.split() == columns
    assert max(map(len, lines)) <= int(width) and not any("…" in line for line in lines)


def test_explanations_fit_the_usual_terminal(explained, capsys):
    console.print_changes(explained, explain=True)
    printed = capsys.readouterr().out
    assert printed.startswith("3 changes: 1 appeared, 1 disappeared, 1 moved\n")
    assert "\n   +3.1  92 % of it lies where the other survey looked through\n" in printed
    assert max(map(len, printed.splitlines())) <= 80
    assert "--explain" not in printed


def test_a_single_explanation_is_of_one_object(explained, capsys):
    console.print_changes(explained, explain=True, only=1)
    printed = capsys.readouterr().out
    assert "1  ● moved" in printed.split("Contributions")[1]
    assert "0  ● disappeared" not in printed.split("Contributions")[1] and "rejected" not in printed


def test_rejected_candidates_are_one_line_unless_they_are_asked_for(pair, explained, capsys):
    console.print_changes(explained)
    printed = capsys.readouterr().out
    assert "2 candidates were rejected; --explain says why.\n" in printed
    assert "looked through" not in printed
    console.print_changes(pair[2])
    assert "--explain" not in capsys.readouterr().out


def test_a_displaced_surface_that_is_no_change_is_told(explained, capsys):
    console.print_changes(dataclasses.replace(explained, rejected=(displaced(0.64, 9000),)))
    printed = " ".join(capsys.readouterr().out.split())
    assert "Most of the 9,000 points at " in printed and "and were judged unchanged: a bent" in printed


def test_sentences_are_no_markup(explained, capsys):
    fact = dataclasses.replace(explained[0].explanation.contributions[0], sentence="[red]3[/red] points")
    item = dataclasses.replace(
        explained[0], explanation=dataclasses.replace(explained[0].explanation, contributions=(fact,))
    )
    console.print_changes(dataclasses.replace(explained, items=(item,)), explain=True)
    assert "[red]3[/red] points" in capsys.readouterr().out


def test_json_is_what_the_file_holds(pair, capsys):
    console.print_json(pair[2])
    captured = capsys.readouterr()
    assert json.loads(captured.out) == json.loads(json.dumps(pair[2].to_dict()))
    assert not captured.err


def test_names_are_no_markup(tmp_path, capsys):
    console.print_files(tmp_path / "[red]", {"a": "text"})
    assert "[red]" in capsys.readouterr().out


def test_what_controls_the_terminal_is_shown_escaped(tmp_path, capsys):
    console.print_files(tmp_path / "\x1b[31mred\x07", {"a": "text"})
    with console.shown_warnings():
        warnings.warn("scan \x1b]0;title\x07.ply: in feet?", InputWarning, stacklevel=1)
    captured = capsys.readouterr()
    assert r"\x1b[31mred\x07" in captured.out and "\x1b" not in captured.out
    assert captured.err == "gmmjax: warning: scan \\x1b]0;title\\x07.ply: in feet?\n"


def test_a_terminal_breaks_messages_between_words(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    console.print_note("the scans are compared although --sensor-before says that nothing was seen")
    lines = capsys.readouterr().err.splitlines()
    assert max(map(len, lines)) <= 40 and any("--sensor-before" in line for line in lines)
    assert lines[0].startswith("gmmjax: ") and all(line.startswith("  ") for line in lines[1:])


@pytest.mark.parametrize(("quiet", "shown"), [(False, "gmmjax: warning: in feet?\n"), (True, "")])
def test_warnings_are_one_line(capsys, quiet, shown):
    with console.shown_warnings(quiet=quiet):
        warnings.warn("in feet?", InputWarning, stacklevel=1)
    assert capsys.readouterr().err == shown


def test_progress_says_nothing_where_there_is_no_terminal(capsys):
    with console.progress_bar() as progress:
        progress("Fitting", 0.5)
    assert capsys.readouterr() == ("", "")
