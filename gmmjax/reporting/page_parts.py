"""What the HTML pages are made of: assets of the package, and data that scripts read."""

import json
from importlib.resources import files
from typing import Any


def asset(name: str) -> str:
    """The text of a file in `assets/`."""
    return files("gmmjax.reporting").joinpath("assets", name).read_text(encoding="utf-8")


def script_json(content: Any) -> str:
    """JSON that cannot end the script element that it stands in."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
