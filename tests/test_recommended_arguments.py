"""Errors and warnings recommend options and settings that there are."""

import ast
import dataclasses
import re
from importlib import import_module
from pathlib import Path

from gmmjax import DetectionConfig
from gmmjax.cli.application import COMMANDS
from gmmjax.cli.options import options_of

ROOT = Path(__file__).parents[1]
# Of pip and PDAL.
OTHERS = {"--help", "--help-all", "--upgrade", "--filters", "--writers"}


def messages():
    """The texts of all errors and warnings of the package."""
    for path in sorted((ROOT / "gmmjax").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in (
                "InputError",
                "ComputationError",
                "warn",
            ):
                parts = [part.value for part in ast.walk(node) if isinstance(part, ast.Constant)]
                yield path.name, " ".join(part for part in parts if isinstance(part, str))


def test_options_are_those_of_the_command_line():
    known = set(OTHERS)
    for name, (module, _) in COMMANDS.items():
        command = getattr(import_module(f"gmmjax.cli.{module}"), name.replace(" ", "_"))
        known |= {option.flag for option in options_of(command)}
    assert len(known) > 50
    # A name that goes on, as in --sensor-{side}, is no option yet.
    option = re.compile(r"--[a-z0-9-]*[a-z0-9](?![a-z0-9-])")
    assert {(name, own) for name, text in messages() for own in option.findall(text) if own not in known} == set()


def test_settings_are_those_of_the_configuration():
    known = {field.name for field in dataclasses.fields(DetectionConfig)}
    named = {
        setting
        for _, text in messages()
        for given in re.findall(r"DetectionConfig\(([^)]*)\)", text)
        for setting in re.findall(r"(\w+)=", given)
    }
    assert named and named <= known


def test_settings_of_a_detection_are_not_recommended_as_arguments():
    """`detect_changes` has no `unit=`: its settings are those of `DetectionConfig`."""
    settings = "unit|crop|voxel_size|registration|tolerance|noise_floor|max_components"
    for name, text in messages():
        bare = re.sub(r"DetectionConfig\([^)]*\)", "", text)
        assert not re.search(rf"\b({settings})=\.\.\.", bare), (name, text)
