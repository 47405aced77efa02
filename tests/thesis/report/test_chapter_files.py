import dataclasses

import pytest

from gmmjax import InputError
from gmmjax.thesis.chapter4 import PartResult, Plan, Table, ThesisResults
from gmmjax.thesis.chapter4.records import Unit
from gmmjax.thesis.report import chapter_files, open_folder, print_thesis, write_results
from tests.thesis.report.test_chapter_page import OUTCOMES, part

PLAN = Plan(3)
UNIT = Unit("grid", "c", 0, "m", {}, dict)


@pytest.fixture
def folder(tmp_path):
    """Of an earlier run, with one result."""
    open_folder(tmp_path / "new" / "run", PLAN).add(UNIT, {"value": 1})
    return tmp_path / "new" / "run"


def test_an_earlier_run_goes_on(folder):
    assert open_folder(folder, PLAN).result(UNIT) == {"value": 1}


def test_a_run_of_other_settings_is_left_alone(folder):
    with pytest.raises(InputError, match=r"other settings \(first_seed 3, not 4; trials 10, not 1\).*--overwrite"):
        open_folder(folder, dataclasses.replace(PLAN, first_seed=4, trials=1))
    assert UNIT in open_folder(folder, PLAN)


def test_a_run_of_another_version_is_left_alone(folder, monkeypatch):
    monkeypatch.setattr("gmmjax.__version__", "99.0")
    with pytest.raises(InputError, match=r"another version of gmmjax"):
        open_folder(folder, PLAN)


def test_overwrite_begins_anew(folder):
    (folder / "index.html").write_text("old")
    (folder / "figure-4.9.csv").write_text("old")
    assert UNIT not in open_folder(folder, Plan(4), overwrite=True)
    assert {path.name for path in folder.iterdir()} == {"settings.json"}


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path):
    (tmp_path / "precious.txt").write_text("precious")
    for overwrite in (False, True):
        with pytest.raises(InputError, match=r"precious\.txt"):
            open_folder(tmp_path, PLAN, overwrite=overwrite)
    assert [path.name for path in tmp_path.iterdir()] == ["precious.txt"]


def test_a_page_and_a_file_for_each_table_are_written(folder):
    modules = list(OUTCOMES)
    results = ThesisResults(PLAN, tuple(part(module) for module in modules), ())
    names = write_results(folder, results)
    assert set(names) == {chapter_files.PAGE, *chapter_files.TABLES}
    assert all((folder / name).stat().st_size for name in names)
    assert UNIT in open_folder(folder, PLAN)


def test_the_summary_is_printed_with_every_line(capsys, tmp_path):
    parts = tuple(part(module) for module in OUTCOMES)
    unfit = PartResult("filtering", (Table("4.6", "t", ()),), (), (), ("install open3d",))
    print_thesis(ThesisResults(PLAN, (*parts, unfit), ()), tmp_path)
    captured = capsys.readouterr()
    lines = captured.out.splitlines()
    assert lines[0].split() == ["Figure", "Measure", "Method", "Here", "Thesis"]
    assert sum(len(own.headlines) for own in parts) < len(lines)
    assert any("F1, single frames" in line and "0.70" in line for line in lines)
    assert "index.html" in captured.out and captured.err == "gmmjax: install open3d\n"
