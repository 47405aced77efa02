"""Prints constraints for pip: the lowest version of each package that gmmjax and its tests depend on."""

import re
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
for requirement in sorted({*project["dependencies"], *project["optional-dependencies"]["test"]}):
    name, lowest = re.match(r"([\w-]+)(?:\[.*\])?>=([\d.]+)", requirement).groups()
    print(f"{name}=={lowest}")
