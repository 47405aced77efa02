import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import jaxtyping
import numpy as np
import pytest

import gmmjax
from gmmjax.geometry import transformed

ROOT = Path(__file__).parents[1]
HEAVY = {
    *(
        "optimistix",
        "optax",
        "open3d",
        "ott",
        "matplotlib",
        "laspy",
        "lazrs",
        "pandas",
        "sklearn",
        "rich",
    ),
    *("rosbags", "lz4", "PIL", "ruamel"),
}

# JAX's settings before and after, the modules that are there, and whether JAX can still be told its devices.
LOOK = """
import json, sys
import jax
before = dict(jax.config.values)
import gmmjax
for name in dir(gmmjax):
    getattr(gmmjax, name)
after = dict(jax.config.values)
jax.config.update("jax_num_cpu_devices", 2)
print(json.dumps({
    "changed": sorted(name for name in after if after[name] != before.get(name)),
    "settings": len(after),
    "x64": jax.config.jax_enable_x64,
    "modules": sorted(name for name in sys.modules if "." not in name),
    "devices": len(jax.devices("cpu")),
}))
"""


@pytest.fixture(scope="module")
def imported():
    """What a fresh process says after `import gmmjax`, where every warning is an error."""
    paths = [str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    environment["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    done = subprocess.run([sys.executable, "-W", "error", "-c", LOOK], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


@pytest.mark.slow
def test_nothing_is_said(imported):
    assert imported[1] == ""


def test_no_heavy_module_is_imported(imported):
    assert HEAVY.isdisjoint(imported[0]["modules"])


def test_the_public_names_are_those_that_type_checkers_see():
    source = (ROOT / "gmmjax" / "__init__.py").read_text()
    declared = dict(re.findall(r"^    from gmmjax\.\w+ import (\w+) as (\w+)$", source, re.MULTILINE))
    assert set(declared) == set(gmmjax._HOMES)
    for name, package in gmmjax._HOMES.items():
        assert f"from gmmjax.{package} import {name} as {name}\n" in source
        assert name in dir(gmmjax)
        assert getattr(gmmjax, name) is getattr(importlib.import_module(f"gmmjax.{package}"), name)
    with pytest.raises(AttributeError, match="no attribute 'detect_change'"):
        gmmjax.detect_change  # noqa: B018


def test_only_the_command_line_imports_the_reproduction_of_the_thesis():
    package = ROOT / "gmmjax"
    importing = {
        path.relative_to(package).parts[0]
        for path in package.rglob("*.py")
        if re.search(
            r"\bgmmjax\.thesis\b.* import |import gmmjax\.thesis|from gmmjax import .*thesis", path.read_text()
        )
    }
    assert importing == {"cli", "thesis"}


def test_no_setting_of_jax_is_changed(imported):
    found, _ = imported
    assert found["settings"] > 50
    assert found["changed"] == []
    assert found["x64"] is False


def test_no_device_is_started(imported):
    assert imported[0]["devices"] == 2


def test_packages_import_each_other_through_their_faces():
    """What another package may use of a package is what its `__init__` exports.

    The command line takes modules of the reports by themselves: each is imported when its command is run.
    """
    beyond = {"reporting", "thesis"}
    found = []
    for path in (ROOT / "gmmjax").rglob("*.py"):
        own = path.relative_to(ROOT / "gmmjax").parts[0]
        modules = re.findall(r"^ *from gmmjax\.(\w+)\.[\w.]+ import", path.read_text(), re.MULTILINE)
        found += [(path.name, package) for package in modules if package not in {own, *beyond}]
    assert found == []


def test_imports_go_one_way():
    """Each package imports only from those above it, as docs/design.md lists them, each stage from those before it."""
    order = re.findall(r"^  (\w+)/ ", (ROOT / "docs" / "design.md").read_text(), re.MULTILINE)
    stages = ["config", "registration", "change", "prepare", "align", "fit", "differences", "candidates", "evidence"]
    stages += ["objects", "detectors", "detect"]
    assert {"geometry", "changes", "cli"} < set(order)
    for root, places in (("gmmjax", order), ("gmmjax.changes", stages)):
        folder = ROOT / root.replace(".", "/")
        for path in folder.rglob("*.py"):
            own = path.relative_to(folder).parts[0].removesuffix(".py")
            # Of any depth, so also in functions and for type checkers.
            for module in re.findall(rf"^ *(?:from|import) {root}\.(\w+)", path.read_text(), re.MULTILINE):
                if own in places and module in places:
                    assert places.index(module) <= places.index(own), f"{path} imports {module}"


def test_few_modules_import_packages_by_name():
    """What `import_module` imports the test of the order cannot see."""
    package = ROOT / "gmmjax"
    found = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if re.search(r"import_module|__import__", path.read_text())
    }
    assert found == {"__init__.py", "_lazy_names.py", "_presenters.py", "cli/application.py", "native/__init__.py"}


def test_types_and_shapes_are_checked_in_tests_from_the_first_call_on():
    for _ in range(2):
        with pytest.raises(jaxtyping.TypeCheckError, match="points"):
            transformed(np.zeros((4, 2)), np.eye(4))
        assert transformed(np.zeros((4, 3)), np.eye(4)).shape == (4, 3)
