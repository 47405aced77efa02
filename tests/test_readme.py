"""The README and the pages of docs/ say what is so."""

import dataclasses
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import gmmjax
from gmmjax.cli import main
from gmmjax.cli.application import COMMANDS

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
OPTION = re.compile(r"--[a-z][a-z0-9-]*")


def blocks(page, language):
    """The code blocks of a page in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def show_help(words):
    """Prints the help of a command."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "200")
        assert main([*words, "--help-all"]) == 0


def options_of_section(name):
    """The options in the tables of a section of the page of the command line."""
    page = (ROOT / "docs" / "command-line.md").read_text(encoding="utf-8")
    section = re.search(rf"^## {name}\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE)
    assert section is not None
    rows = re.findall(r"^\| `(--[^|]*)\|", section[1], re.MULTILINE)
    return {option for row in rows for option in OPTION.findall(row)}


@pytest.mark.parametrize("command", COMMANDS)
def test_the_options_of_a_command_are_those_of_its_help(command, capsys):
    show_help(command.split())
    by_help = {line.split()[0] for line in capsys.readouterr().out.splitlines() if line.startswith("  --")}
    by_page = options_of_section(command)
    if command.startswith("evaluate") and command != "evaluate thesis":
        by_page |= options_of_section("evaluate")
    if command == "batch":
        settings = {f"--{field.name.replace('_', '-')}" for field in dataclasses.fields(gmmjax.DetectionConfig)}
        by_page |= settings | {"--no-evidence", "--no-recognise-stations"}
        by_page -= {"--evidence", "--recognise-stations"}
    assert by_page == by_help


@pytest.mark.parametrize("command", ["detect", "batch", "extract", "tune"])
def test_the_help_is_short(command, capsys):
    assert main([command, "--help"]) == 0
    printed = capsys.readouterr().out
    assert sum(line.startswith("  --") for line in printed.splitlines()) <= 15
    assert f"gmmjax {command} --help-all shows all options." in printed


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_have_the_options_they_are_given(page, capsys):
    lines = [line for block in blocks(page, "sh") for step in block.split("&&") for line in step.splitlines()]
    calls = [shlex.split(line)[1:] for line in lines if re.match(r"\s*(\.venv/bin/)?gmmjax\s", line)]
    for words in calls:
        name = next(command for command in COMMANDS if " ".join(words).startswith(command))
        show_help(name.split())
        assert {word for word in words if word.startswith("--")} <= set(OPTION.findall(capsys.readouterr().out))


def test_the_extras_exist():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = {
        extra
        for page in PAGES
        for found in re.findall(r"'(?:\.|gmmjax)\[([a-z0-9,]+)\]'", page.read_text(encoding="utf-8"))
        for extra in found.split(",")
    }
    assert named
    assert named <= set(project["optional-dependencies"])


def test_the_version_is_one():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert gmmjax.__version__ == project["version"]
    assert f"## [{project['version']}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_checks_run_the_tests_as_the_readme_does():
    (command,) = re.findall(r"python -m pytest[^\n]*", README.read_text(encoding="utf-8"))
    assert command.removeprefix("python ") in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def python_examples(tmp_path_factory):
    """The folder in which the README's Python code was run as one program, and what it printed."""
    folder = tmp_path_factory.mktemp("readme")
    paths = [str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(blocks(README, "python"))],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in paths if path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


@pytest.mark.slow
def test_the_python_code_does_what_it_says(python_examples):
    folder, printed = python_examples
    assert {change.kind for change in gmmjax.Changes.load(folder / "scene-result").items} == {"appeared", "disappeared"}
    assert "(8, 500) [16 16 16 16 16 16 16 16]" in printed


def test_the_files_are_as_described(python_examples):
    """The example of changes.json has the keys of a real one, and labels.npz the arrays that are named."""
    result = python_examples[0] / "scene-result"
    page = ROOT / "docs" / "files.md"
    (example,) = blocks(page, "json")
    assert keys(json.loads(example)) == keys(json.loads((result / "changes.json").read_text(encoding="utf-8")))
    with np.load(result / "labels.npz", allow_pickle=False) as arrays:
        assert all(f"`{name}`" in page.read_text(encoding="utf-8") for name in arrays.files)


def keys(value):
    """The names in nested dictionaries; of a list, those of its first entry."""
    if isinstance(value, dict):
        return {name: keys(inner) for name, inner in value.items()}
    return keys(value[0]) if isinstance(value, list) and value else None
