"""Nested plain values, such as settings and diagnostics, as tables of a page."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any


def values_table(value: Any) -> str:
    """Nested plain values as nested tables; lists of scalars on one line.

    Args:
        value: numbers, texts, lists and mappings, in any depth.
    """
    if isinstance(value, Mapping):
        rows = "".join(
            f'<tr><th scope="row">{escape(_readable(str(name)))}</th><td>{values_table(content)}</td></tr>'
            for name, content in value.items()
        )
        return f'<table class="values">{rows}</table>' if rows else "none"
    if isinstance(value, str) or not isinstance(value, Sequence):
        return escape(_scalar(value))
    if any(isinstance(item, Mapping | list | tuple) for item in value):
        return "".join(f'<div class="item">{values_table(item)}</div>' for item in value)
    return escape(", ".join(_scalar(item) for item in value)) if value else "none"


def _scalar(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}" if abs(value) >= 10_000 else str(value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _readable(name: str) -> str:
    words = name.replace("_", " ")
    return words[:1].upper() + words[1:]
