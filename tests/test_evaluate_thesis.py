"""`gmmjax evaluate thesis` on small surveys."""

import csv

import pytest

from gmmjax.cli import main
from gmmjax.thesis.chapter4 import filtering, surveys
from tests.thesis.chapter4.pairs import floor_sources

COMMAND = ["evaluate", "thesis", "--quick", "--parts", "surveys", "filtering"]


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """A floor with a box in place of the laboratory; JAX's own variable keeps its settings as they are."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    for part in (surveys, filtering):
        monkeypatch.setattr(part, "survey_sources", floor_sources)


@pytest.mark.slow
def test_it_runs_writes_resumes_and_begins_anew(tmp_path, capsys, monkeypatch):
    out = tmp_path / "thesis"
    calls = []
    published = surveys.published

    def interrupted(*arguments):
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return published(*arguments)

    monkeypatch.setattr(surveys, "published", interrupted)
    assert main([*COMMAND, "--out", str(out)]) == 130
    said = capsys.readouterr().err
    assert "results are kept" in said and "the same command goes on" in said
    assert not (out / "index.html").exists()

    assert main([*COMMAND, "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert "F1, localised maps" in printed.out and not printed.err
    with (out / "figure-4.10.csv").open() as file:
        rows = {(row["data"], row["method"]): row for row in csv.DictReader(file)}
    assert rows["single frames", "joint"]["pairs"] == "1" and rows["single frames", "thesis"]["f1"] == "0.7"
    assert (out / "index.html").read_text().startswith("<!doctype html>")

    journal = (out / "progress.jsonl").read_bytes()
    assert main([*COMMAND, "--out", str(out), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "") and (out / "progress.jsonl").read_bytes() == journal


@pytest.mark.parametrize(
    ("flags", "message"), [(["--first-seed", "-1"], "--first-seed -1"), (["--parts"], "--parts is empty")]
)
def test_bad_options_are_named(flags, message, tmp_path, capsys):
    assert main(["evaluate", "thesis", "--out", str(tmp_path / "a"), *flags]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_a_folder_of_another_run_is_refused(tmp_path, capsys):
    from gmmjax.thesis.chapter4 import Plan
    from gmmjax.thesis.report import open_folder

    open_folder(tmp_path / "a", Plan())
    assert main([*COMMAND, "--out", str(tmp_path / "a")]) == 2
    assert "other settings" in capsys.readouterr().err
