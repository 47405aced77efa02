import csv

import pytest
from matplotlib.figure import Figure

from gmmjax import InputError
from gmmjax.cli import main
from gmmjax.evaluation import Failure
from gmmjax.thesis.chapter4 import PARTS, chapter
from gmmjax.thesis.chapter4.table import Part, Table


@pytest.fixture(autouse=True)
def ran(monkeypatch):
    """Parts that compute nothing; those that ran, with their seeds."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")
    ran = {}

    def part(name, seeds, progress):
        progress("working", 0.5)
        ran[name] = list(seeds)
        rows = [{"method": "joint", "f1": 0.5, "pairs": 2}, {"method": "a, b", "f1": None, "pairs": None}]
        failures = (Failure("p", "m", "why"),) if name == "surveys" else ()
        return Part([Table(f"9.{PARTS.index(name)}", "title", "said", rows, rows[:1], Figure())], failures, ("a note",))

    runs = {name: (lambda *given, name=name: part(name, *given), 5, 1) for name in PARTS}
    monkeypatch.setattr(chapter, "RUN", runs)
    return ran


def test_every_part_is_written_with_its_tables_and_figures(tmp_path, ran):
    shares = []
    chapter.run_chapter(tmp_path / "a", PARTS[:2], first_seed=7, progress=lambda stage, share: shares.append(share))
    assert ran == {"clustering": [7, 8, 9, 10, 11], "filtering": [7, 8, 9, 10, 11]} and shares == [0.25, 0.75]
    assert {path.name for path in (tmp_path / "a").iterdir()} == {
        *("clustering.md", "filtering.md", "figure-9.0.csv", "figure-9.0.png", "figure-9.1.csv", "figure-9.1.png")
    }
    with (tmp_path / "a" / "figure-9.0.csv").open() as file:
        assert list(csv.reader(file)) == [["method", "f1", "pairs"], ["joint", "0.5", "2"], ["a, b", "", ""]]
    page = (tmp_path / "a" / "clustering.md").read_text()
    assert page.startswith("# Clustering\n\nSeeds 7 to 11.\n\na note\n\n## Figure 9.0: title\n")
    assert "(figure-9.0.png)" in page and "| method | f1 | pairs |\n| --- | --- | --- |\n| joint | 0.50 | 2 |\n" in page


def test_parts_that_are_done_are_kept_and_others_added(tmp_path, ran):
    chapter.run_chapter(tmp_path, ["clustering"], quick=True)
    before = (tmp_path / "clustering.md").read_bytes()
    with pytest.raises(
        InputError, match=r"clustering\.md is there already; --overwrite replaces it, --parts runs others"
    ):
        chapter.run_chapter(tmp_path, PARTS)
    chapter.run_chapter(tmp_path, ["gaussians"], quick=True)
    assert list(ran) == ["clustering", "gaussians"] and (tmp_path / "clustering.md").read_bytes() == before
    chapter.run_chapter(tmp_path, ["clustering"], first_seed=1, quick=True, overwrite=True)
    assert "Seeds 1 to 1." in (tmp_path / "clustering.md").read_text()


def test_the_command_prints_a_summary_and_what_failed(tmp_path, capsys):
    out = tmp_path / "thesis"
    assert main(["evaluate", "thesis", "--out", str(out), "--quick", "--parts", "surveys"]) == 1
    printed = capsys.readouterr()
    lines = [line.split() for line in printed.out.splitlines()]
    assert ["Figure", "9.3:", "title"] in lines and ["joint", "0.50", "2"] in lines
    assert "The thesis: said" in printed.out and "thesis" in printed.out.splitlines()[-1]
    assert "a note" in printed.err and "m on p: why" in printed.err
    assert main(["evaluate", "thesis", "--out", str(out), "--parts", "clustering", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("flags", "message"), [(["--first-seed", "-1"], "--first-seed -1"), (["--parts"], "--parts is empty")]
)
def test_bad_options_are_named(flags, message, tmp_path, capsys):
    assert main(["evaluate", "thesis", "--out", str(tmp_path / "a"), *flags]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "a").exists()
