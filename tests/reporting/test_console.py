import json
import warnings

import pytest

from gmmjax.errors import InputWarning
from gmmjax.reporting import console


def test_the_table_fits_the_usual_terminal(pair, capsys):
    console.print_changes(pair[2])
    printed = capsys.readouterr().out
    assert printed.startswith("3 changes: 1 appeared, 1 disappeared, 1 moved\n")
    assert all(kind in printed for kind in ("appeared", "disappeared", "moved"))
    assert "…" not in printed
    assert "1 row of the before cloud" in printed


def test_no_figure_is_cut_off_in_a_narrow_terminal(pair, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "30")
    console.print_changes(pair[2])
    assert "…" not in capsys.readouterr().out


def test_json_is_what_the_file_holds(pair, capsys):
    console.print_json(pair[2])
    captured = capsys.readouterr()
    assert json.loads(captured.out) == json.loads(json.dumps(pair[2].to_dict()))
    assert not captured.err


def test_names_are_no_markup(tmp_path, capsys):
    console.print_files(tmp_path / "[red]", {"a": "text"})
    assert "[red]" in capsys.readouterr().out


@pytest.mark.parametrize(("quiet", "shown"), [(False, "gmmjax: warning: in feet?\n"), (True, "")])
def test_warnings_are_one_line(capsys, quiet, shown):
    with console.shown_warnings(quiet=quiet):
        warnings.warn("in feet?", InputWarning, stacklevel=1)
    assert capsys.readouterr().err == shown


def test_progress_says_nothing_where_there_is_no_terminal(capsys):
    with console.progress_bar() as progress:
        progress("Fitting", 0.5)
    assert capsys.readouterr() == ("", "")
