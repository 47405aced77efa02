"""Typesets the formulas of these pages as pictures when they are built: browsers need no script and no font for them.

A hook of MkDocs: arithmatex has marked the LaTeX, in the pages and in the docstrings.
"""

import html
import re
from typing import Any

import ziamath

# The pictures are measured at this size, pixels, and grow with the text that they stand in.
SIZE = 16.0
MARKED = re.compile(r'<(?P<tag>span|div) class="arithmatex">\\[(\[](?P<latex>.*?)\\[)\]]</(?P=tag)>', re.DOTALL)


def on_page_content(content: str, **kwargs: Any) -> str:
    """The page with a picture in place of each marked formula."""
    del kwargs
    return MARKED.sub(_typeset, content)


def _typeset(found: re.Match[str]) -> str:
    tag, latex = found["tag"], " ".join(html.unescape(found["latex"]).split())
    # Each picture holds its glyphs itself: pictures that share them would need names that are unique on the page.
    ziamath.config.svg2 = False
    formula = ziamath.Latex(latex, size=SIZE, color="currentColor", inline=tag == "span")
    width, height = (length / SIZE for length in formula.getsize())
    below = formula.getyofst() / SIZE
    picture = formula.svg().replace(
        "<svg ",
        f'<svg role="img" aria-label="{html.escape(latex)}" style="width: {width:.3f}em; height: {height:.3f}em; '
        f'vertical-align: {below:.3f}em" ',
        1,
    )
    return f'<{tag} class="arithmatex">{picture}</{tag}>'
