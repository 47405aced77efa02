import dataclasses
import errno
import json
import logging
import os
import re
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import jax
import numpy as np
import pytest

import gmmjax
from gmmjax import _compilation_cache as compilation_cache
from gmmjax.changes import Changes, Registration
from gmmjax.cli import main
from gmmjax.cli.application import COMMANDS as PROGRAMS
from gmmjax.cli.application import as_given
from gmmjax.cli.detect import detect
from gmmjax.cli.options import parsed
from gmmjax.clouds import SensorViews, read_cloud, write_pcd, write_ply, write_views
from gmmjax.errors import ComputationError
from gmmjax.reporting import read_mixture
from tests.changes.explained import explanation, rejected
from tests.changes.scanned_objects import motion

QUICK = ["--restarts", "2", "--max-components", "8"]
MEANS = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 1], [5, 5, 1], [2, 10, 3]])
DETECT = ["--method", "transport", *QUICK]

pytestmark = pytest.mark.usefixtures("no_compilation_cache")


def clouds(points=150):
    """Four Gaussians, and after that a fifth one."""
    random = np.random.default_rng(0)
    cloud = random.normal(size=(5 * points, 3)) * 0.3 + np.repeat(MEANS, points, axis=0)
    return cloud[: 4 * points], cloud + random.normal(size=cloud.shape) * 0.01


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    """The paths of a pair of scans; a row of the first is lost."""
    folder = tmp_path_factory.mktemp("scans")
    before, after = clouds()
    np.save(folder / "before.npy", np.insert(before, 3, np.nan, axis=0))
    write_ply(folder / "after.ply", after)
    return str(folder / "before.npy"), str(folder / "after.ply")


@pytest.fixture(scope="module")
def result(scans, tmp_path_factory):
    """The folder of one detection."""
    folder = tmp_path_factory.mktemp("results") / "result"
    assert main(["detect", *scans, "--out", str(folder), "--quiet", *DETECT]) == 0
    return folder


def failed(arguments, capsys):
    """What a run that must end with status 2 says: one line, on standard error."""
    assert main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert not captured.out
    assert captured.err.startswith("gmmjax: error: ")
    assert captured.err.count("\n") == 1
    return captured.err


def test_detect_writes_every_output(result):
    names = "changes.json changes.csv changes.geojson labels.npz before.ply after.ply report.html config.toml"
    assert {path.name for path in result.iterdir()} == set(names.split())


def test_detect_finds_what_appeared(result):
    changes = Changes.load(result)
    assert [change.kind for change in changes.items] == ["appeared"]
    assert (changes.labels_after[600:] == 0).mean() > 0.95
    assert (changes.labels_before == -1).all()


@pytest.fixture(scope="module")
def surveys(tmp_path_factory):
    """The same pair of clouds as of `scans`, each as two scans: of one name, in two folders, and of two formats."""
    folder = tmp_path_factory.mktemp("surveys")
    before, after = clouds()
    (folder / "b").mkdir()
    np.save(folder / "scan <1>.npy", np.insert(before[:250], 3, np.nan, axis=0))
    np.save(folder / "b" / "Scan <1>.npy", before[250:])
    write_ply(folder / "after.ply", after[:300], fields={"intensity": np.arange(300, dtype=np.int16)})
    write_pcd(folder / "after.pcd", after[300:], fields={"ring": np.arange(450, dtype=np.uint8)})
    return [folder / "scan <1>.npy", folder / "b" / "Scan <1>.npy"], [folder / "after.ply", folder / "after.pcd"]


def test_surveys_of_several_scans_are_one_cloud_each(result, surveys, tmp_path):
    """What is found is that of the whole clouds; each scan is written by itself."""
    folder = tmp_path / "out"
    words = ["detect", "--before", *surveys[0], "--after", *surveys[1], "--out", folder, "--quiet", *DETECT]
    assert main([str(word) for word in words]) == 0
    whole, changes = Changes.load(result), Changes.load(folder)
    np.testing.assert_array_equal(changes.labels_after, whole.labels_after)
    np.testing.assert_array_equal(changes.probability_before, whole.probability_before)
    names = ["before/scan <1>.ply", "before/Scan <1>-2.ply", "after/after.ply", "after/after-2.pcd"]
    assert {str(path.relative_to(folder)) for path in folder.glob("*/*")} == {*names}
    read = [read_cloud(folder / name) for name in names]
    assert read[0].fields["row"].tolist() == [0, 1, 2, *range(4, 251)] and "row" not in read[1].fields
    labels = np.concatenate([cloud.fields["label"] for cloud in read[2:]])
    np.testing.assert_array_equal(labels, changes.labels_after)
    assert read[2].fields["intensity"].dtype == np.int16 and "ring" not in read[2].fields
    np.testing.assert_array_equal(read[3].fields["ring"], np.arange(450, dtype=np.uint8))
    assert changes.diagnostics["after"]["source"] == "after.ply, after.pcd"


def test_a_survey_replaces_a_result_and_is_replaced(scans, surveys, tmp_path, capsys):
    several = ["--before", *surveys[0], "--after", *surveys[1]]
    for given in (scans, several, scans):
        words = ["detect", *given, "--out", tmp_path / "out", *DETECT, "--overwrite"]
        assert main([str(word) for word in words]) == 0
        printed = capsys.readouterr().out
        assert ("before/" in printed) == (tmp_path / "out" / "before").is_dir() == (given is several)
        assert (tmp_path / "out" / "before.ply").exists() == (given is scans)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("A", "give either two scans as BEFORE AFTER, or"),
        ("A B --before A B", "and not some of both"),
        ("--before A B", "--before FILE ... --after FILE ..."),
        ("A --after A B", "and not some of both"),
        ("--before A A --after B", "is given twice as a scan of one survey"),
        ("--before A B --after B --sensor-before 1 2 3", "1 position for 2 scans; give X Y Z for each of them"),
        ("--before A B --after B --sensor-before 1 2 3 4 5 6 7 8 9", "3 positions for 2 scans"),
    ],
)
def test_scans_that_are_given_wrongly(scans, tmp_path, capsys, words, message):
    files = {"A": scans[0], "B": scans[1]}
    said = failed(["detect", *(files.get(word, word) for word in words.split()), "--out", tmp_path / "out"], capsys)
    assert message in said
    assert not (tmp_path / "out").exists()


def test_flags_and_their_values_reach_the_settings(result):
    settings = tomllib.loads((result / "config.toml").read_text())
    assert (settings["restarts"], settings["max_components"], settings["method"]) == (2, 8, "transport")


def test_the_written_config_reproduces_the_result(result, scans, tmp_path):
    again = tmp_path / "again"
    assert main(["detect", *scans, "--out", str(again), "--config", str(result / "config.toml"), "--quiet"]) == 0
    first, second = Changes.load(result), Changes.load(again)
    assert first.config == second.config
    np.testing.assert_array_equal(first.labels_after, second.labels_after)
    np.testing.assert_array_equal(first.probability_after, second.probability_after)


def test_flags_win_over_the_config_file(result, scans, tmp_path):
    arguments = ["--out", str(tmp_path / "again"), f"--config={result / 'config.toml'}", "--seed", "7", "--quiet"]
    assert main(["detect", *scans, *arguments]) == 0
    config = Changes.load(tmp_path / "again").config
    assert (config.seed, config.restarts) == (7, 2)


def test_json_stands_alone_on_standard_output(scans, tmp_path, capsys):
    arguments = ["--out", str(tmp_path / "a"), "--json", *DETECT]
    assert main(["detect", *scans, *arguments]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [change["kind"] for change in printed["changes"]] == ["appeared"]
    assert printed["schema_version"] == 3


def test_the_table_says_what_was_found_dropped_and_written(scans, tmp_path, capsys):
    assert main(["detect", *scans, "--out", str(tmp_path / "a"), *DETECT]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith("1 change: 1 appeared\n")
    assert "1 row of the before cloud" in captured.out
    assert str(tmp_path / "a") in captured.out
    assert not captured.err


def test_explain_reaches_the_terminal(scans, result, tmp_path, capsys, monkeypatch):
    changes = dataclasses.replace(Changes.load(result), rejected=(rejected(),))
    monkeypatch.setattr("gmmjax.changes.detect_changes", lambda *clouds, **settings: changes)
    assert main(["detect", *scans, "--out", str(tmp_path / "a"), "--explain"]) == 0
    assert "\n1 candidate was rejected:\n● disappeared   20 %  unchanged" in capsys.readouterr().out
    assert main(["detect", *scans, "--out", str(tmp_path / "b")]) == 0
    assert "\n1 candidate was rejected; --explain says why.\n" in capsys.readouterr().out
    assert Changes.load(tmp_path / "b").rejected[0].explanation == changes.rejected[0].explanation


def test_one_change_is_explained_by_its_label(scans, result, tmp_path, capsys, monkeypatch):
    item = dataclasses.replace(Changes.load(result)[0], explanation=explanation())
    changes = dataclasses.replace(Changes.load(result), items=(item,), rejected=(rejected(),))
    monkeypatch.setattr("gmmjax.changes.detect_changes", lambda *clouds, **settings: changes)
    assert main(["detect", "--explain", *scans, "--out", str(tmp_path / "all")]) == 0
    assert "candidate was rejected:" in capsys.readouterr().out
    assert main(["detect", *scans, "--out", str(tmp_path / "a"), "--explain", "0"]) == 0
    printed = capsys.readouterr().out
    assert "\n0  ● appeared  changed 90 %" in printed and "rejected:" not in printed
    assert main(["detect", *scans, "--out", str(tmp_path / "b"), "--explain", "7"]) == 2
    captured = capsys.readouterr()
    assert "--explain 7" in captured.err and "the labels are: 0\n" in captured.err
    assert captured.out.startswith("1 change") and (tmp_path / "b" / "changes.json").exists()


def test_an_explanation_is_of_a_label(scans, tmp_path, capsys):
    assert "--explain -1: must be" in failed(["detect", *scans, "--out", tmp_path / "a", "--explain=-1"], capsys)
    assert not (tmp_path / "a").exists()


def test_the_report_has_a_link_that_can_be_followed(scans, result, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("gmmjax.changes.detect_changes", lambda *clouds, **settings: Changes.load(result))
    assert main(["detect", *scans, "--out", str(tmp_path / "ä b#[1]")]) == 0
    assert f"\nOpen {tmp_path.as_uri()}/%C3%A4%20b%23%5B1%5D/report.html in a browser.\n" in capsys.readouterr().out


@pytest.mark.parametrize(("flags", "shown"), [([], ""), (["-v"], "stage\n"), (["-vv"], "stage\ngmmjax.x: detail\n")])
def test_verbose_shows_the_log(scans, result, tmp_path, capsys, monkeypatch, flags, shown):
    handlers = list(logging.getLogger("gmmjax").handlers)

    def detect_changes(*clouds, **settings):
        logging.getLogger("gmmjax").info("st%s", "age")
        logging.getLogger("gmmjax.x").debug("detail")
        return Changes.load(result)

    monkeypatch.setattr("gmmjax.changes.detect_changes", detect_changes)
    assert main(["detect", *scans, "--out", str(tmp_path / "a"), *flags]) == 0
    told = re.sub(r"^ *[0-9.]+ s  ", "", capsys.readouterr().err, flags=re.MULTILINE)
    assert told.endswith(shown) and bool(told) == bool(shown)
    assert logging.getLogger("gmmjax").handlers == handlers


@pytest.mark.parametrize(
    ("options", "positions"),
    [
        ("--sensor-before 2 -5.5 -1e-1 --sensor-after 0 1 2 3 4 5", ([[2, -5.5, -0.1]], [[0, 1, 2], [3, 4, 5]])),
        ("--sensor-at-origin", ([[0, 0, 0]], [[0, 0, 0]])),
        ("--sensor-after 1 2 3", (None, [[1, 2, 3]])),
    ],
)
def test_positions_of_the_sensor_become_views(scans, result, tmp_path, monkeypatch, options, positions):
    given = {}

    def detect_changes(*clouds, **settings):
        given.update(settings)
        return Changes.load(result)

    monkeypatch.setattr("gmmjax.changes.detect_changes", detect_changes)
    assert main(["detect", *scans, "--out", str(tmp_path / "a"), "--quiet", *options.split()]) == 0
    for side, own in zip(("before", "after"), positions, strict=True):
        views = given[f"views_{side}"]
        assert (own is None) == (views is None)
        if views is not None:
            np.testing.assert_allclose(views.poses[:, :3, 3], own)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--sensor-before", "0", "0", "0", "--views-before", "v.json"], "--views-before and --sensor-before"),
        (["--sensor-at-origin", "--sensor-after", "0", "0", "0"], "--sensor-after and --sensor-at-origin"),
        (["--sensor-before", "0", "0"], "2 numbers"),
        (["--sensor-after"], "0 numbers"),
        (["--sensor-before", "0", "nan", "0"], "finite"),
        (["--sensor-after", "1e5", "0", "0"], "away from a cloud"),
    ],
)
def test_positions_that_no_sensor_had_are_refused(scans, tmp_path, capsys, options, message):
    assert message in failed(["detect", *scans, "--out", tmp_path / "a", *options], capsys)
    assert not (tmp_path / "a").exists()


def test_quiet_prints_nothing(scans, tmp_path, capsys):
    assert main(["detect", *scans, "--out", str(tmp_path / "a"), "--quiet", *DETECT]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("options", [[], ["--transform-after"]])
def test_the_after_scan_keeps_its_coordinates_unless_asked_for(scans, result, tmp_path, monkeypatch, options):
    registration = Registration(motion(0.2, [0.3, 0.1, 0.0]), applied=True)
    changes = dataclasses.replace(Changes.load(result), registration=registration)
    monkeypatch.setattr("gmmjax.changes.detect_changes", lambda *clouds, **settings: changes)
    assert main(["detect", *scans, "--quiet", "--out", str(tmp_path / "out"), *options]) == 0
    after = read_cloud(scans[1]).points
    expected = registration.apply(after) if options else after
    np.testing.assert_array_equal(read_cloud(tmp_path / "out" / "after.ply").points, expected)


def test_rows_of_the_source_are_in_the_labelled_cloud(result):
    rows = read_cloud(result / "before.ply").fields["row"]
    np.testing.assert_array_equal(rows, np.delete(np.arange(601), 3))


@pytest.mark.parametrize("flat", [[1, 1, 0], [1, 0, 0]], ids=["plane", "line"])
def test_clouds_on_a_plane_or_a_line_work(tmp_path, flat):
    before, after = (cloud * flat for cloud in clouds())
    np.save(tmp_path / "before.npy", before)
    np.save(tmp_path / "after.npy", after)
    paths = [str(tmp_path / name) for name in ("before.npy", "after.npy")]
    assert main(["detect", *paths, "--out", str(tmp_path / "a"), "--quiet", *DETECT]) == 0
    assert np.isfinite(Changes.load(tmp_path / "a").probability_after).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [(lambda points: points * 1000, "unit"), (lambda points: points + 1e3, "do not overlap")],
)
def test_other_frames_and_units_are_refused(tmp_path, capsys, change, message):
    before, after = clouds()
    np.save(tmp_path / "before.npy", before)
    np.save(tmp_path / "after.npy", change(after))
    paths = [str(tmp_path / name) for name in ("before.npy", "after.npy")]
    assert main(["detect", *paths, "--out", str(tmp_path / "a"), *DETECT]) == 2
    told = capsys.readouterr().err
    assert "gmmjax: error: " in told and message in told
    assert not (tmp_path / "a").exists()


def binary_ply(folder):
    write_ply(folder / "whole.ply", np.random.default_rng(0).normal(size=(50, 3)))
    return (folder / "whole.ply").read_bytes()


BAD_CLOUDS = {
    "missing.ply": (None, "no such file"),
    "empty.ply": (lambda folder: b"", "empty"),
    "truncated.ply": (lambda folder: binary_ply(folder)[:-100], "cut off"),
    "garbage.ply": (lambda folder: bytes(range(256)), "PLY"),
    "scan.docx": (lambda folder: b"text", "format"),
    "none.xyz": (lambda folder: b"\n", "points"),
    "one.xyz": (lambda folder: b"1 2 3\n", "1 point "),
    "three.xyz": (lambda folder: b"1 2 3\n4 5 6\n7 8 8\n", "3 points"),
    "equal.xyz": (lambda folder: b"1 2 3\n" * 100, "equal"),
    "lost.xyz": (lambda folder: b"nan 2 3\n" * 100, "NaN"),
}


@pytest.mark.parametrize("name", BAD_CLOUDS)
@pytest.mark.parametrize("command", ["detect", "fit"])
def test_bad_clouds_are_named_and_nothing_is_written(command, name, scans, tmp_path, capsys):
    make, message = BAD_CLOUDS[name]
    path = tmp_path / name
    if make is not None:
        path.write_bytes(make(tmp_path))
    there = sorted(tmp_path.iterdir())
    others = [scans[1]] if command == "detect" else []
    said = failed([command, path, *others, "--out", tmp_path / "a"], capsys)
    if command == "detect" or message not in ("1 point ", "3 points", "equal"):
        assert name in said
        assert message in said
    assert sorted(tmp_path.iterdir()) == there


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--max-components", "100000"], "--max-components 100000"),
        (["--restarts", "0"], "--restarts 0"),
        (["--threshold", "2"], "--threshold 2"),
        (["--config", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_bad_settings_are_named(scans, tmp_path, capsys, flags, message):
    assert message in failed(["detect", *scans, "--out", tmp_path / "a", *flags], capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "message"),
    [("restarts = ", "not TOML"), ("restart = 3", "unknown setting restart"), ("restarts = 0", "restarts=0")],
)
def test_bad_config_files_are_named(scans, tmp_path, capsys, text, message):
    (tmp_path / "config.toml").write_text(text)
    arguments = ["detect", *scans, "--out", tmp_path / "a", "--config", tmp_path / "config.toml"]
    said = failed(arguments, capsys)
    assert "config.toml" in said
    assert message in said


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ([], "give a command"),
        (["detekt", "a"], "detekt is no command; do you mean detect?"),
        (["simulate"], "do you mean simulate gaussians or simulate lab?"),
        (["évaluate\x1b[1m", "pairs"], r"\x1b[1m is no command; do you mean evaluate pairs?"),
    ],
)
def test_a_word_that_is_no_command_is_answered_with_what_may_be_meant(words, meant, capsys):
    assert meant in failed(words, capsys)


def test_the_overview_fits_the_terminal(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    assert main(["--help"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 60 and all(f"  {name} " in "\n".join(lines) for name in PROGRAMS)


@pytest.mark.parametrize("command", ["detect", "evaluate pairs", "extract", "tune"])
def test_help_is_for_people_and_fits_the_terminal(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main([*command.split(), "--help"]) == 0
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) <= 80
    assert "(default: None)" not in text and "INT" not in text and "Args:" not in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--restarts x", "--restarts: 'x' is not a whole number"),
        ("--tolerance 3,5", "'3,5' is not a number"),
        ("--crop 1 2 3 4 5", "--crop takes 6 values: X Y Z X Y Z"),
        ("--unit", "--unit takes one value: UNIT"),
        ("--method jiont", "--method: 'jiont' is none of joint, greedy, transport"),
        ("--treshold 0.9", "--treshold: there is no such option; do you mean --threshold?"),
    ],
)
def test_wrong_usage_is_said_in_a_line(words, message, capsys):
    assert message in failed(["detect", "a.ply", "b.ply", "--out", "c", *words.split()], capsys)


def test_help_imports_neither_jax_nor_scipy():
    look = "import sys; sys.argv = ['gmmjax', 'detect', '--help']; from gmmjax.cli import main\ntry: main()\nfinally: "
    look += "print([name for name in ('jax', 'scipy', 'equinox') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("\n[]\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("detect a b", "the following arguments are required: --out"),
        ("fit --out c", "CLOUD is missing"),
        ("fit a b --out c", "'b': more than the command takes"),
        ("fit a --out c --what", "--what: there is no such option; --help-all lists them"),
    ],
)
def test_what_is_missing_or_too_much_is_said(words, message, capsys):
    assert message in failed(words.split(), capsys)


def test_options_are_given_in_any_way():
    """Between the scans, with underscores, with `=`, negative numbers and exponents; switches in both senses."""
    words = "--explain a.ply --crop -1 -1e-1 0 1 1 2 b.ply --out=c --max_components 4 --no-evidence -vv --before c d"
    assert parsed(detect, words.split()) == {
        **{"scan_before": Path("a.ply"), "scan_after": Path("b.ply"), "before": (Path("c"), Path("d"))},
        **{"out": Path("c"), "explain": "all", "verbose": 2},
        "settings": {"crop": (-1.0, -0.1, 0.0, 1.0, 1.0, 2.0), "max_components": 4, "evidence": False},
    }
    assert parsed(detect, ["--out", "c", "--explain", "3"])["explain"] == "3"
    assert parsed(detect, ["--out", "c", "--evidence"])["settings"] == {"evidence": True}


COMMANDS = {
    "detect": lambda scans: ["detect", *scans],
    "fit": lambda scans: ["fit", scans[1]],
    "simulate": lambda scans: ["simulate", "gaussians"],
    "demo": lambda scans: ["demo"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_an_output_path_that_cannot_be_written_is_found_out_first(command, scans, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("gmmjax.changes.detect_changes", None)
    (tmp_path / "file").write_text("precious")
    said = failed([*COMMANDS[command](scans), "--out", tmp_path / "file" / "below"], capsys)
    assert str(tmp_path / "file") in said
    assert (tmp_path / "file").read_text() == "precious"


@pytest.mark.parametrize("command", ["detect", "fit", "simulate"])
def test_an_output_folder_that_holds_something_else_is_left_alone(command, scans, tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("precious")
    said = failed([*COMMANDS[command](scans), "--out", tmp_path, "--overwrite"], capsys)
    assert "thesis.tex" in said
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_previous_result_is_replaced_only_with_overwrite(scans, tmp_path, capsys):
    arguments = ["detect", *scans, "--out", str(tmp_path / "a"), "--quiet", *DETECT]
    assert main(arguments) == 0
    assert "--overwrite" in failed(arguments, capsys)
    assert main([*arguments, "--seed", "3", "--overwrite"]) == 0
    assert Changes.load(tmp_path / "a").config.seed == 3


def test_a_disk_that_fills_leaves_nothing(scans, tmp_path, capsys, monkeypatch):
    def full_disk(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full_disk)
    said = failed(["detect", *scans, "--out", tmp_path / "new" / "a", *DETECT], capsys)
    assert "No space left on device" in said
    assert str(tmp_path / "new" / "a") in said
    assert not list(tmp_path.iterdir())


def test_an_interruption_is_clean(scans, tmp_path, capsys, monkeypatch):
    def interrupted(*arguments, **settings):
        raise KeyboardInterrupt

    monkeypatch.setattr("gmmjax.changes.detect_changes", interrupted)
    assert main(["detect", *scans, "--out", str(tmp_path / "a")]) == 130
    assert "Traceback" not in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_fit_writes_the_mixture(scans, tmp_path, capsys):
    assert main(["fit", scans[1], "--out", str(tmp_path / "a"), *QUICK]) == 0
    mixture = read_mixture(tmp_path / "a")
    np.testing.assert_allclose(sorted(mixture.means[:, 1]), [0, 0, 5, 5, 10], atol=0.2)
    assert capsys.readouterr().out.startswith("5 Gaussians\n")


def test_fit_leaves_stray_points_out(scans, tmp_path, capsys):
    np.save(tmp_path / "stray.npy", np.concatenate([read_cloud(scans[1]).points, [[3.4e38, 0, 0]]]))
    assert main(["fit", str(tmp_path / "stray.npy"), "--out", str(tmp_path / "a"), *QUICK]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith("5 Gaussians\n")
    assert "stray.npy: 1 stray point lies" in " ".join(printed.err.split())
    settings = json.loads((tmp_path / "a" / "mixture.json").read_text())["settings"]
    assert (settings["points"], settings["stray"]) == (750, 1)


def test_fit_reduces_to_voxels_and_keeps_every_points_weight(scans, tmp_path):
    arguments = ["fit", scans[1], "--out", str(tmp_path / "a"), "--voxel-size", "0.3", "--quiet", *QUICK]
    assert main(arguments) == 0
    content = json.loads((tmp_path / "a" / "mixture.json").read_text())
    assert content["settings"]["points_fitted"] < content["settings"]["points"] == 750
    nearest = np.linalg.norm(np.array(content["means"])[:, None] - MEANS, axis=2).argmin(axis=1)
    np.testing.assert_allclose(np.bincount(nearest, content["weights"]), np.full(5, 1 / 5), atol=0.02)


def test_fit_names_the_cloud_that_it_cannot_fit(scans, tmp_path, capsys):
    write_ply(tmp_path / "equal.ply", np.ones((50, 3)))
    write_ply(tmp_path / "three.ply", np.arange(9.0).reshape(3, 3))
    out = ["--out", str(tmp_path / "a"), "--restarts", "1"]
    assert "equal.ply: all points are equal" in failed(["fit", str(tmp_path / "equal.ply"), *out], capsys)
    assert "three.ply: points has 3 observations" in failed(["fit", str(tmp_path / "three.ply"), *out], capsys)
    assert "max_components=9000" in failed(["fit", scans[1], "--max-components", "9000", *out], capsys)
    assert not (tmp_path / "a").exists()


def test_simulate_gaussians_writes_clouds_that_detect_reads(tmp_path):
    words = f"simulate gaussians --points 50 --quiet --out {tmp_path}"
    assert main(f"{words}/a --disappeared 2 --seed 5".split()) == 0
    truth = np.load(tmp_path / "a" / "truth_before.npy", allow_pickle=False)
    assert len(truth) == len(read_cloud(tmp_path / "a" / "before.ply")) == 250
    assert set(truth) == {-1, 0, 1}
    assert main(f"{words}/b --fixed".split()) == 0
    assert len(read_cloud(tmp_path / "b" / "after.ply")) == 350


@pytest.mark.slow
def evaluated(command, capsys, *arguments):
    """What an evaluation prints."""
    assert main(["evaluate", *command, *map(str, arguments)]) == 0
    captured = capsys.readouterr()
    assert not captured.err
    return captured.out


@pytest.mark.slow
def test_evaluate_gaussians_scores_the_detectors_that_are_asked_for(tmp_path, capsys):
    table, curves = tmp_path / "table.md", tmp_path / "curves.json"
    flags = ["--seeds", 1, "--points", 300, "--conditions", "(+1) low*", "(none)*", "--restarts", 2]
    printed = evaluated(
        ["gaussians"], capsys, *flags, "--methods", "transport", "c2c", "--out", table, "--reliability", curves
    )
    assert printed.splitlines()[1] == "(+1) low, 300 points"
    assert "all 3 of thesis" in printed
    assert table.read_text().count("| c2c |") == 4
    assert list(json.loads(curves.read_text())) == ["transport"]


def test_an_evaluation_can_be_read_by_programs(capsys):
    flags = ["--families", "separation", "--conditions", "*low, 1 sd*", "--seeds", 2, "--methods", "c2c"]
    rows = json.loads(evaluated(["gaussians"], capsys, *flags, "--json"))["rows"]
    assert [(row["condition"], row["pairs"]) for row in rows] == [("(-1 +1) low, 1 sd apart", 2)]


@pytest.fixture
def pairs(tmp_path):
    """A folder with a pair of depth frames."""
    generator = np.random.default_rng(0)
    wall = np.column_stack([generator.uniform(-0.5, 0.5, (2000, 2)), np.full(2000, 2.0)])
    thing = np.column_stack([generator.uniform(-0.1, 0.1, (200, 2)), np.full(200, 1.5)])
    for name in ("frame", "scan"):
        folder = tmp_path / "pairs" / name
        folder.mkdir(parents=True)
        np.save(folder / "before.npy", wall)
        np.save(folder / "after.npy", np.concatenate([wall, thing]))
        np.save(folder / "truth_before.npy", np.full(2000, -1))
        np.save(folder / "truth_after.npy", np.repeat([-1, 0], [2000, 200]))
        write_views(folder / "before_views.json", SensorViews.at_origin(wall))
    return tmp_path / "pairs"


def test_evaluate_pairs_scores_a_folder(pairs, capsys):
    printed = evaluated(["pairs"], capsys, pairs, "--methods", "c2c", "--json")
    rows = {row["condition"]: row for row in json.loads(printed)["rows"]}
    assert rows["frame"]["f1"] == rows["scan"]["f1"] == 1


@pytest.mark.parametrize("poses", ["given", "unknown"])
def test_the_views_of_pairs_can_be_kept_from_the_detectors(pairs, poses, capsys, monkeypatch):
    views = []

    def evaluate(detectors, sources, **settings):
        views.extend(
            cloud.views for source in sources for pair in [source.load()] for cloud in (pair.before, pair.after)
        )
        raise ComputationError("seen enough")

    monkeypatch.setattr("gmmjax.evaluation.evaluate", evaluate)
    assert main(["evaluate", "pairs", str(pairs), "--poses", poses, "--methods", "c2c"]) == 1
    assert [view is None for view in views] == [poses == "unknown", True] * 2


def test_a_pair_that_fails_does_not_lose_the_others(pairs, capsys):
    np.save(pairs / "scan" / "truth_after.npy", np.zeros(7, int))
    assert main(["evaluate", "pairs", str(pairs), "--methods", "c2c"]) == 1
    captured = capsys.readouterr()
    assert "frame" in captured.out
    assert captured.err.startswith("gmmjax: failed: scan: ") and captured.err.count("\n") == 1


def test_a_folder_of_which_nothing_can_be_evaluated_is_an_error(pairs, capsys):
    for name in ("frame", "scan"):
        np.save(pairs / name / "truth_after.npy", np.zeros(7, int))
    assert main(["evaluate", "pairs", str(pairs), "--methods", "c2c"]) == 1
    assert capsys.readouterr().err.startswith("gmmjax: error: nothing could be evaluated: frame: ")


def test_evaluate_laboratory_surveys_a_room(capsys):
    flags = ["--seeds", 1, "--surveys", "frame", "--conditions", "(+1)", "--methods", "c2c", "--poses", "given"]
    assert evaluated(["laboratory"], capsys, *flags).splitlines()[1] == "(+1)"


@pytest.mark.slow
def test_evaluate_scenes_surveys_places_of_a_family(capsys):
    flags = ["--families", "apartments", "--seeds", 1, "--poses", "unknown", "--methods", "voxels", "--json"]
    rows = {row["condition"]: row for row in json.loads(evaluated(["scenes"], capsys, *flags))["rows"]}
    assert rows["apartments"]["pairs"] == 1 and rows["apartments"]["group"] == "poses unknown"


BAD_EVALUATIONS = {
    "gaussians --out a.xlsx": ".csv, .json, .md",
    "gaussians --reliability a.csv": ".png, .svg, .pdf, .json",
    "gaussians --out nowhere/a.csv": "no folder nowhere",
    "gaussians --seeds 0": "--seeds 0",
    "gaussians --first-seed -1": "--first-seed -1",
    f"gaussians --first-seed {10**30}": "below 2^63",
    "gaussians --points 0": "--points 0",
    "gaussians --conditions (+9)*": "fits none of (+1) low; (+1) medium",
    "laboratory --conditions (+9)": "fits none of (+1); (+2)",
    "scenes --families room": "--families room: there is no such family; choose from rooms, kitchens",
    "scenes --seeds 0": "--seeds 0",
    "pairs nowhere": "nowhere: there is no such folder",
}


@pytest.mark.parametrize("words", BAD_EVALUATIONS)
def test_bad_evaluations_are_refused_first(words, capsys, monkeypatch):
    monkeypatch.setattr("gmmjax.evaluation.evaluate", None)
    assert BAD_EVALUATIONS[words] in failed(["evaluate", *words.split()], capsys)


def test_m3c2_is_refused_where_it_cannot_run(capsys, monkeypatch):
    monkeypatch.setattr("gmmjax.evaluation.detectors.has_m3c2", lambda: False)
    assert "'.[peers]'" in failed(["evaluate", "gaussians", "--methods", "m3c2"], capsys)


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"gmmjax {gmmjax.__version__}\n"


@pytest.mark.slow
def test_the_module_is_the_command(tmp_path):
    arguments = ["detect", "nowhere.ply", "nowhere.ply", "--out", str(tmp_path / "a")]
    ended = subprocess.run([sys.executable, "-m", "gmmjax", *arguments], capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stderr.startswith("gmmjax: error: nowhere.ply: no such file")
    assert "Traceback" not in ended.stderr


# Runs the program as the words after it say, and sends Ctrl-C when a module is first looked for.
INTERRUPTED_AT = """
import importlib.abc, os, runpy, signal, sys

_, module, way, *words = sys.argv
sys.argv = ["gmmjax", *words]
# Tests that a shell runs in the background inherit that it is ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)

class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == module:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
if way == "-m":
    runpy.run_module("gmmjax", run_name="__main__", alter_sys=True)
else:
    from gmmjax.cli import main
    sys.exit(main())
"""


@pytest.mark.parametrize(("module", "way"), [("gmmjax.cli.detect", "-m"), ("jax", "script")])
def test_an_interruption_of_the_imports_is_clean(tmp_path, module, way):
    arguments = [module, way, "detect", "nowhere.ply", "nowhere.ply", "--out", str(tmp_path / "a")]
    ended = subprocess.run([sys.executable, "-c", INTERRUPTED_AT, *arguments], capture_output=True, text=True)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "gmmjax: interrupted\n")


def test_ctrl_c_is_as_before_after_the_command(tmp_path):
    before = signal.getsignal(signal.SIGINT)
    assert main(["detect", "nowhere.ply", "nowhere.ply", "--out", str(tmp_path / "a")]) == 2
    assert signal.getsignal(signal.SIGINT) is before


@pytest.fixture
def closed_pipe():
    """The writing end of a pipe whose reader has gone, as in `gmmjax ... | head -1`."""
    reader, writer = os.pipe()
    os.close(reader)
    yield writer
    os.close(writer)


def test_a_reader_that_goes_ends_the_program_as_it_ends_others(closed_pipe):
    """With the status that a shell gives for SIGPIPE, and no word."""
    command = [sys.executable, "-m", "gmmjax", "--help"]
    ended = subprocess.run(command, stdout=closed_pipe, stderr=subprocess.PIPE, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (141, "")


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_what_was_written_before_the_reader_went_is_whole(scans, tmp_path, closed_pipe, monkeypatch, more):
    with monkeypatch.context() as patch, os.fdopen(os.dup(closed_pipe), "w") as output:
        patch.setattr(sys, "stdout", output)
        assert main(["detect", *scans, "--out", str(tmp_path / "a"), *DETECT, *more]) == 141
    assert Changes.load(tmp_path / "a").items


@pytest.fixture
def jax_settings(monkeypatch):
    """JAX's settings are as before when the test ends."""
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    names = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
    before = {name: getattr(jax.config, name) for name in names}
    jax.config.update("jax_compilation_cache_dir", None)
    yield
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.mark.usefixtures("jax_settings")
@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="the folder is another one there")
def test_compiled_programs_are_kept_in_the_users_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    compilation_cache.use_compilation_cache()
    assert jax.config.jax_compilation_cache_dir == str(tmp_path / "gmmjax" / "compiled")


@pytest.mark.usefixtures("jax_settings")
@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="the folder is another one there")
def test_a_cache_that_cannot_be_written_is_passed_over(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    before = jax.config.jax_compilation_cache_dir
    compilation_cache.use_compilation_cache()
    assert jax.config.jax_compilation_cache_dir == before


@pytest.mark.parametrize(
    ("words", "message", "shown"),
    [
        (["--tile-size", "0.01"], "tile_size=0.01 is too small", "--tile-size 0.01 is too small"),
        (["--tile-size=0.01"], "tile_size=0.01 is too small", "--tile-size 0.01 is too small"),
        # What was not given is named as in the library, and what a file says as in the file.
        (["--tile-size", "1"], "restarts=0 must be at least 1", "restarts=0 must be at least 1"),
        (["--restarts", "2"], "runs.csv: line 2: restarts=many", "runs.csv: line 2: restarts=many"),
    ],
)
def test_arguments_are_named_as_they_were_given(words, message, shown):
    assert as_given(message, ["detect", "a.las", "b.las", *words]) == shown
