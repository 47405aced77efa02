"""The blocks of code of the README and the documentation, their commands, and the headings that links lead to."""

import inspect
import re
import shlex
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from gmmjax.cli.application import COMMANDS
from gmmjax.cli.options import parsed

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = [README, ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
# Why a block is not run: the comment before it says `<!-- not run: REASON -->`, which no reader of the page sees.
REASONS = {
    "synopsis": "capital letters stand for names of the reader",
    "minutes": "a measurement or a simulation of minutes to hours; its commands are parsed",
    "installs": "installs packages, which the machine that runs the tests already has",
    "of the repository": "runs these tests, the tools of development, or another checkout; not gmmjax",
    "real scans": "needs scans that are not in the repository; its commands are parsed",
}
BLOCK = re.compile(
    r"^(?P<indent> *)(?:<!-- not run: (?P<reason>[^>]*?) -->\n+ *)?```(?P<language>\w+)\n(?P<text>.*?)^ *```$",
    re.DOTALL | re.MULTILINE,
)
# Steps of a block that is run which are left out: what they do has been done, or is done by other tests.
DONE = (
    (re.compile(r"python3 -m venv \S+"), "an environment is there"),
    (re.compile(r"\S*pip install .*"), "gmmjax is installed, with its extras"),
    (re.compile(r"python examples/.*"), "tests/test_examples.py runs the examples"),
)


class Block(NamedTuple):
    """A block of code.

    Attributes:
        language: of the fence.
        text: without the indent of a list.
        reason: why it is not run; None: it is.
    """

    language: str
    text: str
    reason: str | None


def blocks(page: Path) -> list[Block]:
    """All blocks of a page that name a language, in order."""
    found = []
    for match in BLOCK.finditer(page.read_text(encoding="utf-8")):
        indent = len(match["indent"])
        lines = [line[indent:] if line[:indent].isspace() else line for line in match["text"].splitlines(keepends=True)]
        found.append(Block(match["language"], "".join(lines), match["reason"]))
    return found


def steps(block: Block) -> Iterator[list[str]]:
    """The words of each command of a block for the shell."""
    for line in block.text.replace("\\\n", " ").splitlines():
        for step in line.split("&&"):
            words = shlex.split(step, comments=True)
            if words and not any(pattern.fullmatch(" ".join(words)) for pattern, _ in DONE):
                yield words


def gmmjax_words(words: list[str]) -> list[str] | None:
    """The arguments, if the command is gmmjax."""
    return words[1:] if words[0] in ("gmmjax", ".venv/bin/gmmjax") else None


def bind_arguments(words: list[str]) -> None:
    """Parse a command of gmmjax and bind its arguments to its function, without calling it."""
    name = next(command for command in COMMANDS if " ".join(words).startswith(command))
    function = getattr(import_module(f"gmmjax.cli.{COMMANDS[name][0]}"), name.replace(" ", "_"))
    inspect.signature(function).bind(**parsed(function, words[len(name.split()) :]))


def anchors(page: Path) -> set[str]:
    """The names of a page's headings, as GitHub and MkDocs make them, and those that are given to it."""
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {_slug(heading) for heading in headings} | set(re.findall(r'\{ ?#([\w-]+) ?\}|<a id="([\w-]+)">', text))


def _slug(heading: str) -> str:
    words = re.sub(r"\[([^]]*)\]\([^)]*\)|[`*]|\{.*\}", r"\1", heading)
    return re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", words.lower()).strip())
