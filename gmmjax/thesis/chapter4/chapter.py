"""Chapter 4 as a folder of tables and figures: one part of the chapter after the other."""

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from gmmjax.clouds import atomic_write
from gmmjax.errors import InputError
from gmmjax.plotting import write_figure
from gmmjax.reporting import console
from gmmjax.thesis.chapter4 import PartName
from gmmjax.thesis.chapter4.accuracy import Progress, partly
from gmmjax.thesis.chapter4.clustering import clustering
from gmmjax.thesis.chapter4.detections import filtering, gaussians, surveys
from gmmjax.thesis.chapter4.table import Part, as_text

# Each part with the number of its seeds, and that of a quick run.
RUN: Mapping[PartName, tuple[Callable[[Sequence[int], Progress], Part], int, int]] = {
    "clustering": (clustering, 20, 3),
    "filtering": (filtering, 10, 1),
    "gaussians": (gaussians, 10, 1),
    "surveys": (surveys, 20, 1),
}


def run_chapter(
    folder: Path,
    parts: Sequence[PartName],
    *,
    first_seed: int = 0,
    quick: bool = False,
    overwrite: bool = False,
    progress: Progress = lambda stage, share: None,
) -> list[Part]:
    """Run parts of the chapter, and write each as soon as it is done.

    Args:
        folder: for `PART.md`, `figure-4.9.csv`, `figure-4.9.png`, ...; created where needed.
        parts: to run.
        first_seed: first seed; the others follow.
        quick: a small run.
        overwrite: replace parts that are there.
        progress: called with a description of the current step and the fraction of them that is done.

    Raises:
        InputError: a part is there already, or a file cannot be written.
        ComputationError: nothing of a part could be run.
    """
    for name in parts:
        if (folder / f"{name}.md").exists() and not overwrite:
            raise InputError(f"{folder / name}.md is there already; --overwrite replaces it, --parts runs others")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror}); choose another folder") from error
    results = []
    for number, name in enumerate(parts):
        run, whole, few = RUN[name]
        seeds = range(first_seed, first_seed + (few if quick else whole))
        results.append(run(seeds, functools.partial(partly, progress, number, len(parts))))
        _write(folder, name, seeds, results[-1])
    return results


def print_part(part: Part) -> None:
    """Print the summary of each table beside what the thesis says, and notes on what could not be run."""
    for own in part.tables:
        console.print_text(f"Figure {own.number}: {own.title}", "bold")
        console.print_text(f"The thesis: {own.thesis}", "dim")
        table = console.plain_table()
        for name, value in own.brief[0].items():
            table.add_column(name, justify="left" if isinstance(value, str) else "right", no_wrap=True)
        for row in own.brief:
            table.add_row(*map(as_text, row.values()))
        console.print_whole(table)
    for note in part.notes:
        console.print_note(note)


def _write(folder: Path, name: PartName, seeds: range, part: Part) -> None:
    contents = {f"figure-{table.number}.csv": table.to_csv() for table in part.tables}
    lines = [f"# {name.capitalize()}\n\nSeeds {seeds[0]} to {seeds[-1]}.\n", *(f"{note}\n" for note in part.notes)]
    lines += [f"Failed: {failure}.\n" for failure in part.failures]
    contents[f"{name}.md"] = "\n".join([*lines, *(table.to_markdown() for table in part.tables)])
    for table in part.tables:
        write_figure(folder / f"figure-{table.number}.png", table.figure)
    for file_name, content in contents.items():
        with atomic_write(folder / file_name) as file:
            file.write(content.encode())
