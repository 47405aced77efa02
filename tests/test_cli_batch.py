"""`gmmjax batch` as a user types it."""

import csv
import json
import os
import re

import pytest

from gmmjax.batch import PairRow
from gmmjax.batch.worker import failure
from gmmjax.cli import main
from gmmjax.errors import InputError
from gmmjax.reporting.batch_files import Summary
from gmmjax.reporting.console import print_batch
from tests.batch.runs import FLAGS, run, write_manifest


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    return write_manifest(tmp_path_factory.mktemp("scans"), 3)


@pytest.fixture(scope="module")
def done(scans, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    return run(scans, "--out", folder, *FLAGS), folder


def test_it_says_what_changed_and_where_the_files_are(done):
    result, folder = done
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0] == "3 pairs done; 3 with changes"
    assert lines[1].split() == ["Pair", "Changes", "Appeared", "Disappeared", "Moved", "Most", "probable"]
    assert "index.html" in result.stdout
    assert "3 of 3 done" in result.stderr
    assert all(len(line) <= 80 for line in lines if str(folder) not in line)


def test_it_writes_what_it_says(done):
    _, folder = done
    names = set("run.json index.html pairs.csv changes.csv pairs errors".split())
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".")} == names
    files = {"before.ply", "after.ply", "before.webp", "after.webp", "report.html", "config.toml"}
    files |= {"changes.json", "changes.csv", "changes.geojson", "labels.npz", "fits.npz", "pair.json"}
    for pair in (folder / "pairs").iterdir():
        assert {path.name for path in pair.iterdir()} == files
    with (folder / "changes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        changes = json.loads((folder / "pairs" / row["name"] / "changes.json").read_text())["changes"]
        assert float(row["probability"]) == changes[int(row["change"])]["probability"]


def test_a_second_time_there_is_nothing_to_do(scans, done):
    _, folder = done
    again = run(scans, "--out", folder, *FLAGS)
    assert again.returncode == 0
    assert again.stdout == done[0].stdout


@pytest.mark.slow
def test_shards_are_merged(scans, tmp_path):
    folder = tmp_path / "my run"
    first = run(scans, "--out", folder, "--shard", "1/2", *FLAGS)
    assert first.returncode == 0
    assert "2 of 2 done; when all shards are: gmmjax batch --merge --out '" in first.stdout
    assert not (folder / "pairs.csv").exists()
    merged = run("--merge", "--out", folder)
    assert merged.returncode == 1
    assert merged.stdout.splitlines()[0] == "2 of 3 pairs done, 1 missing; 2 with changes"
    run(scans, "--out", folder, "--shard", "2/2", *FLAGS)
    merged = run("--merge", "--out", folder)
    assert merged.returncode == 0
    assert merged.stdout.splitlines()[0] == "3 pairs done; 3 with changes"


@pytest.mark.slow
def test_a_series_has_a_time_line(scans, tmp_path):
    manifest = scans.with_name("epochs.csv")
    manifest.write_text("name,cloud\nMonday,before0.ply\nTuesday,after0.ply\n")
    result = run(manifest, "--out", tmp_path / "run", "--series", *FLAGS)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[0] == "2 epochs, 1 object: 1 came"
    assert {"timeline.html", "objects.csv"} <= set(os.listdir(tmp_path / "run"))


@pytest.mark.slow
def test_a_pair_that_fails_is_listed(scans, tmp_path):
    bad = scans.with_name("bad.ply")
    bad.write_text("no cloud")
    manifest = scans.with_name("bad.csv")
    manifest.write_text("name,before,after\n[red]bad[/red],bad.ply,after1.ply\ngood,before0.ply,after0.ply\n")
    manifest.write_text(manifest.read_text().replace("[/red]", "[red]"))
    result = run(manifest, "--out", tmp_path / "run", *FLAGS)
    assert result.returncode == 1
    assert result.stdout.startswith("1 of 2 pairs done, 1 failed; 1 with changes")
    assert re.search(r"  \[red\]bad\[red\]: .*bad\.ply: is no PLY file", result.stdout)
    stopped = run(manifest, "--out", tmp_path / "other", "--fail-fast", *FLAGS)
    assert stopped.returncode == 1
    assert "gmmjax: error: pair [red]bad[red]: " in stopped.stderr


def test_warnings_and_whole_errors_are_printed(capsys):
    error = f"hall.ply: {'many words and no end of them, ' * 20}"[:-2]
    rows = (
        PairRow("hall", "done", changes=0, warnings="after: 1 stray point\nno poses"),
        PairRow("yard", "failed", failure(InputError(error))),
        PairRow("shed", "failed", failure(ValueError(error))),
    )
    print_batch(Summary(rows, (), ()))
    printed = capsys.readouterr().out
    assert "\n1 with warnings\n  hall: after: 1 stray point; no poses\n" in printed
    assert f"\n2 failed\n  yard: {error}\n" in printed
    assert re.search(r"  shed: ValueError: hall.ply: .* (no|and|end|of|them,|many|words) \.\.\.\n", printed)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "give a MANIFEST, or folders by --pairs"),
        (["{scans}", "--pairs", "x/*/"], "give a MANIFEST, or folders by --pairs"),
        (["{scans}", "--shard", "4/3"], "shard 4/3: the number must be from 1 to 3"),
        (["{scans}", "--until-stable"], "until_stable needs restarts"),
        (["{scans}", "--workers", "0"], "--workers 0 must be at least 1"),
        (["{scans}", "--series", "--shard", "1/2"], "goes without --pairs and --shard"),
        (["{scans}", "--series"], "line 2: has no cloud"),
        (["{scans}.no"], "no such file"),
        (["--merge"], "holds no run (no run.json)"),
        (["--merge", "--shard", "1/2"], "--merge is of all shards"),
        (["--pairs", "nowhere/*/"], "matches no folder"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_written(scans, tmp_path, capsys, words, says):
    folder = tmp_path / "run"
    assert main(["batch", *(word.format(scans=scans) for word in words), "--out", str(folder)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("gmmjax: error: ") and says in error and error.count("\n") == 1
    assert not folder.exists()
