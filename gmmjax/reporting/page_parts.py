"""What the HTML pages are made of: their head, assets of the package, and data that scripts read."""

import json
from html import escape
from importlib.resources import files
from typing import Any

from gmmjax.reporting.palette import KIND_COLORS

# The browser itself then refuses to load anything from anywhere.
CONTENT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)


def page_head(title: str, *sheets: str, policy: str = CONTENT_POLICY) -> str:
    """Begin a page, up to the end of its head, with the styles that all pages share and the colours of the kinds.

    Args:
        title: of the page, as text.
        sheets: styles of this page alone.
        policy: what the browser may load.
    """
    kinds = " ".join(f"--{kind}: {color};" for kind, color in KIND_COLORS.items())
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(title)} · gmmjax</title>
<style>:root {{ {kinds} }}
{asset("base.css")}{"".join(sheets)}</style>
</head>
"""


def asset(name: str, package: str = "gmmjax.reporting") -> str:
    """The text of a file in the folder `assets/` of a package."""
    return files(package).joinpath("assets", name).read_text(encoding="utf-8")


def script_json(content: Any) -> str:
    """JSON that cannot end the script element that it stands in."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
