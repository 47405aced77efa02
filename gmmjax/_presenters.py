"""What shows a record of changes: functions of packages that come after `changes`, imported when they are asked for.

A record has the methods that users look for, `Changes.report`, `plot` and what a notebook calls, and imports nothing
that comes after it: a detection needs neither HTML nor plots.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

_PRESENTERS = {
    "report": ("gmmjax.reporting", "write_report"),
    "notebook": ("gmmjax.reporting", "notebook_html"),
    "plot": ("gmmjax.plotting", "plot_overview"),
}


def presenter(name: str) -> Callable[..., Any]:
    """Return the function that shows a record, whose first argument it is: "report", "notebook" or "plot"."""
    package, function = _PRESENTERS[name]
    found: Callable[..., Any] = getattr(import_module(package), function)
    return found
