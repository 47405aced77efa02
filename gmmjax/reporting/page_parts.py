"""Shared parts of the HTML pages: one skeleton, the assets of the package, and data that scripts read."""

import json
from html import escape
from importlib.resources import files
from typing import Any

from gmmjax import __version__
from gmmjax.reporting.palette import KIND_COLORS

# The browser itself then refuses to load anything from anywhere.
CONTENT_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; font-src data:"
)


def page(title: str, sheet: str, main: str, rest: str, *, policy: str = CONTENT_POLICY) -> str:
    """Make a page with the styles that all pages share, the colours of the kinds, and the version at its end.

    Args:
        title: of the page, as text.
        sheet: name of the asset with the styles of this page alone.
        main: HTML of what it shows.
        rest: HTML that follows, such as scripts.
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
{asset("base.css")}{asset(sheet)}</style>
</head>
<body>
<main>
{main}
<footer>gmmjax {escape(__version__)}</footer>
</main>
{rest}
</body>
</html>
"""


def asset(name: str) -> str:
    """Return the text of a file in the folder `assets/`."""
    return files("gmmjax.reporting").joinpath("assets", name).read_text(encoding="utf-8")


def script(name: str) -> str:
    """Return a script element with an asset."""
    return f"<script>{asset(name)}</script>"


def script_json(name: str, content: Any) -> str:
    """Return a script element of JSON, which cannot end it."""
    text = json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{text}</script>'
