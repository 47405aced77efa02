"""What the HTML pages are made of: assets of the package, and data that scripts read."""

import json
from importlib.resources import files
from typing import Any


def asset(name: str, package: str = "gmmjax.reporting") -> str:
    """The text of a file in the folder `assets/` of a package."""
    return files(package).joinpath("assets", name).read_text(encoding="utf-8")


def script_json(content: Any) -> str:
    """JSON that cannot end the script element that it stands in."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
