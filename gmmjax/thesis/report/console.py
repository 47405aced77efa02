"""The output of `gmmjax evaluate thesis` on the terminal: the summary, and the path of the page."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from gmmjax.reporting import console
from gmmjax.thesis.chapter4 import PartResult, ThesisResults
from gmmjax.thesis.report.chapter_files import PAGE

HEADINGS = ("Figure", "Measure", "Method", "Here", "Thesis")


def print_thesis(results: ThesisResults, folder: Path) -> None:
    """Prints the summary on standard output, and notes on what could not be run on standard error.

    Args:
        results: of `run_chapter`.
        folder: of the page.
    """
    _print_summary(results.parts)
    console.print_report_hint(folder / PAGE)
    for part in results.parts:
        for note in part.notes:
            console.print_note(note)


def _print_summary(parts: Sequence[PartResult]) -> None:
    table = console.plain_table()
    for heading in HEADINGS:
        table.add_column(heading, justify="right" if heading in HEADINGS[3:] else "left", no_wrap=True)
    last = ("", "")
    for line in (line for part in parts for line in part.headlines):
        about = (line.figure, line.measure)
        table.add_row(*(("", "") if about == last else about), *map(escape, (line.method, line.here, line.thesis)))
        last = about
    console.print_whole(table)
