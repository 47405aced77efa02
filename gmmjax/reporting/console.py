"""What the command line shows: progress and warnings on standard error, the answer on standard output."""

import json
import re
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

from gmmjax._messages import print_message
from gmmjax.changes import Changes
from gmmjax.errors import InputWarning, printable
from gmmjax.reporting.explanation_lines import explanation_lines
from gmmjax.reporting.explanations import displaced_text, rejected_text
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.summary import (
    HEADINGS,
    answer,
    dropped_rows,
    dropped_text,
    headings,
    object_rows,
    percent,
    poses_text,
    registration_text,
    unobserved_text,
    volumes_text,
)

if TYPE_CHECKING:
    from gmmjax.clouds import PointCloud
    from gmmjax.evaluation import Evaluation, Failure
    from gmmjax.mixtures import Fit
    from gmmjax.reporting.batch_files import Summary
    from gmmjax.scenes import SurveyedScene
    from gmmjax.surveys import Bag
    from gmmjax.tuning import TuningResult, VerdictResult

# Spaces between the columns of a table.
GAP = 2
NO_BREAK = "\u00a0"


@contextmanager
def progress_bar(*, quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """A progress bar on standard error while the block runs; nothing when `quiet` or where that is no terminal.

    Yields:
        A function of the stage's name and the share of the whole that is done, 0 to 1; to be called from any thread.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        # A bar that is switched off prints an empty line when it ends, with most versions of rich.
        yield lambda stage, share: None
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("Starting", total=1.0)

        def update(stage: str, share: float) -> None:
            progress.update(task, description=stage, completed=share)

        yield update


@contextmanager
def shown_warnings(*, quiet: bool = False) -> Iterator[None]:
    """Shows each `InputWarning` as one line on standard error while the block runs, or none; others as ever."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if quiet else "always", InputWarning)
        show = warnings.showwarning

        def show_line(message: Warning | str, category: type[Warning], *place: Any, **more: Any) -> None:
            if issubclass(category, InputWarning):
                print_message(f"warning: {message}")
            else:
                show(message, category, *place, **more)

        warnings.showwarning = show_line
        yield


def print_changes(
    changes: Changes, *, heading: str | None = None, explain: bool = False, only: int | None = None
) -> None:
    """The answer, a table of the changes, and what was left out of the clouds, on standard output.

    Args:
        changes: what was found.
        heading: a line above the answer.
        explain: why they are changes, and why the rejected candidates are none; otherwise only how many these are.
        only: label of the one change that is explained; None: everything.
    """
    console = Console()
    if heading:
        print_text(heading, style="dim")
    console.print(answer(changes), style="bold", highlight=False)
    if changes.items:
        print_whole(_table(changes, console.width))
    sentences = volumes_text, registration_text, unobserved_text, poses_text, displaced_text
    for text in (sentence(changes) for sentence in sentences):
        if text is not None:
            print_sentence(text)
    for side, count in dropped_rows(changes).items():
        print_sentence(dropped_text(side, count))
    if explain:
        console.print()
        for line, style in explanation_lines(changes, console.width, only=only):
            console.print(escape(line), style=style, highlight=False, soft_wrap=True)
    elif (text := rejected_text(changes)) is not None:
        print_sentence(f"{text}; --explain says why.")


def print_sentence(text: str) -> None:
    """A sentence on standard output, which the terminal breaks between words and never within an option."""
    console = Console()
    width = max(console.width, 20)
    # A number and its unit stay together: a no-break space until the lines are broken.
    text = re.sub(r"(?<=\d) (?=%|[cm]?m[²³]?\b|±)|(?<=±) ", NO_BREAK, printable(text))
    for line in textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False):
        console.print(escape(line.replace(NO_BREAK, " ")), highlight=False, soft_wrap=True)


def print_text(text: str, style: str = "") -> None:
    """A line on standard output, such as a name or a path, that the terminal takes as text whatever is in it."""
    Console().print(escape(printable(text)), style=style, highlight=False, soft_wrap=True)


def print_json(changes: Changes) -> None:
    """What `changes.json` holds, on standard output."""
    print(json.dumps(changes.to_dict(), indent=2, allow_nan=False))


def print_files(folder: Path, description: dict[str, str]) -> None:
    """Prints where the results are.

    Args:
        folder: that holds them.
        description: of each file, by name.
    """
    console = Console()
    console.print(f"\nResults in [bold]{_shown(folder)}[/bold]", highlight=False, soft_wrap=True)
    width = max(len(name) for name in description)
    for name, text in description.items():
        console.print(f"  {name:<{width}}  [dim]{escape(text)}[/dim]", highlight=False, soft_wrap=True)


def print_plot(path: Path | None, what: str = "Plot") -> None:
    """Where the plot is, or another picture, if one was asked for."""
    if path is not None:
        Console().print(f"\n{what} in [bold]{_shown(path)}[/bold]", highlight=False, soft_wrap=True)


def print_batch(summary: "Summary", *, heading: str | None = None, most: int = 10) -> None:
    """How many pairs of a run are done and changed, those that changed most surely, and those that failed.

    Args:
        summary: of the run.
        heading: a line above it.
        most: lines of each list; the others are counted.
    """
    from gmmjax.reporting.batch_index import batch_answer

    console = Console()
    if heading:
        print_text(heading, style="bold")
    console.print(batch_answer(summary.pairs, summary.missing), style="bold", highlight=False, soft_wrap=True)
    changed = sorted((row for row in summary.done if row.changes), key=lambda row: -(row.highest_probability or 0))
    if changed:
        table = plain_table()
        table.add_column("Pair", overflow="ellipsis", no_wrap=True, max_width=40)
        for heading in ("Changes", "Appeared", "Disappeared", "Moved", "Most probable"):
            table.add_column(heading, justify="right", no_wrap=True)
        for row in changed[:most]:
            counts = (row.changes, row.appeared, row.disappeared, row.moved)
            table.add_row(_shown(row.name), *map(str, counts), percent(row.highest_probability or 0))
        console.print(table)
    if len(changed) > most:
        console.print(f"  and {len(changed) - most} more pairs with changes", style="dim", highlight=False)
    warned = [row for row in summary.done if row.warnings]
    for what, entries in (
        ("with warnings", [f"{row.name}: {'; '.join(row.warnings.splitlines())}" for row in warned]),
        ("failed", [f"{row.name}: {row.error}" for row in summary.failed]),
    ):
        if entries:
            console.print(f"\n{len(entries)} {what}", style="bold", highlight=False)
        for text in entries[:most]:
            _print_entry(text)
        if len(entries) > most:
            console.print(f"  and {len(entries) - most} more, in pairs.csv", style="dim", highlight=False)


def _print_entry(text: str) -> None:
    """An entry of a list, whole on one line unless it is a terminal, which breaks it between words."""
    console = Console()
    width = max(console.width, 20) if console.is_terminal else 10_000
    lines = textwrap.wrap(
        printable(text),
        width,
        initial_indent="  ",
        subsequent_indent="    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    for line in lines:
        console.print(escape(line), highlight=False, soft_wrap=True)


def print_fit(fit: "Fit", cloud: "PointCloud") -> None:
    """A mixture in a table, on standard output."""
    mixture = fit.mixture.live_part()
    count = len(mixture.weights)
    console = Console()
    console.print(f"{count} Gaussian{'s' * (count != 1)}", style="bold", highlight=False)
    table = plain_table()
    for heading in ("Weight", "Mean", "Standard deviations"):
        table.add_column(heading, justify="right", no_wrap=True)
    for index in np.argsort(-mixture.weights):
        deviations = np.sqrt(np.linalg.eigvalsh(mixture.covariances[index])[::-1])
        means = ", ".join(f"{value:.3f}" for value in mixture.means[index])
        table.add_row(f"{mixture.weights[index]:.3f}", means, " × ".join(f"{value:.2g}" for value in deviations))
    print_whole(table)
    if cloud.rows_dropped:
        console.print(dropped_text("given", cloud.rows_dropped), highlight=False)


def print_truth(scene: "SurveyedScene", changes: Changes) -> None:
    """The true changes of a simulated scene in a table, each with the label it was found as, on standard output."""
    from gmmjax.reporting.truth_rows import false_labels, truth_rows

    table = plain_table()
    columns = (("Truth", "left"), ("Points", "right"), ("Centre", "right"), ("Motion", "left"), ("Found as", "left"))
    for heading, justify in columns:
        table.add_column(heading, justify=justify, no_wrap=True)  # type: ignore[arg-type]
    for row in truth_rows(scene, changes):
        centre = ", ".join(f"{value:.2f}" for value in row.centre)
        motion = "" if row.motion is None else f"{row.motion[0]:.2f} m, {row.motion[1]:.0f}°"
        found = ", ".join(map(str, row.labels)) or "not found"
        color = KIND_COLORS[row.kind]
        table.add_row(f"[{color}]● {row.kind}[/]", f"{row.points:,}", centre, motion, found)
    console = Console()
    console.print()
    print_whole(table)
    false = false_labels(scene, changes)
    text = f"False changes: {', '.join(map(str, false))}." if false else "No false changes."
    console.print(text, highlight=False)


def print_topics(bag: "Bag") -> None:
    """The topics of a bag in a table, on standard output: type, number of messages, rate and time."""
    topics = bag.topics()
    console = Console()
    begun = f"{datetime.fromtimestamp(bag.start, UTC):%Y-%m-%d %H:%M:%S}" if topics else ""
    length = f"{bag.end - bag.start:.1f} s from {bag.start:.3f} ({begun} UTC)" if topics else "no messages"
    console.print(f"[bold]{_shown(bag.path)}[/bold]  {length}", highlight=False, soft_wrap=True)
    table = plain_table()
    for heading in ("Topic", "Type", "Messages", "Hz", "From (s)", "To (s)"):
        table.add_column(heading, justify="left" if heading in ("Topic", "Type") else "right", no_wrap=True)
    for topic in topics:
        times = ["" if time is None else f"+{time - bag.start:.3f}" for time in (topic.start, topic.end)]
        rate = "" if topic.rate is None else f"{topic.rate:.4g}"
        table.add_row(_shown(topic.name), topic.type.replace("/msg/", "/"), f"{topic.count:,}", rate, *times)
    print_whole(table)


def print_evaluation(evaluation: "Evaluation") -> None:
    """The scores on standard output: under each condition a line for each detector, and at last the sums.

    Args:
        evaluation: at least one row.
    """
    from gmmjax.reporting.evaluation_table import evaluation_lines

    console = Console()
    for text, style in evaluation_lines(evaluation, console.width):
        console.print(escape(text), style=style, highlight=False, soft_wrap=True)


def print_note(text: str) -> None:
    """A line on standard error, about the work and not about its result."""
    print_message(text)


def print_tuning(result: "TuningResult | VerdictResult", settings: Path, picture: Path) -> None:
    """What was tuned, and what to do with the file.

    Args:
        result: of the tuning.
        settings: the TOML file.
        picture: of its course.
    """
    from gmmjax.tuning import VerdictResult

    if isinstance(result, VerdictResult):
        _print_verdict(result)
    else:
        _print_mixture(result)
    Console().print(
        f"\nSettings in [bold]{_shown(settings)}[/bold], the course in {_shown(picture)}",
        highlight=False,
        soft_wrap=True,
    )
    print_next_command(f"gmmjax detect BEFORE AFTER --out DIR --config {settings}")


def _print_verdict(result: "VerdictResult", weights: int = 5) -> None:
    """How the candidates that were held back are judged, and what `detect_changes` finds, before and after.

    Args:
        result: of the tuning.
        weights: of each verdict that are printed, at the most: those that moved most.
    """
    console = Console()
    verdict = "Verdict tuned" if result.improved else "The verdict stays as it was: no better one was found"
    console.print(verdict, style="bold", highlight=False)
    console.print(f"{len(result.pairs)} pairs, each held back once", style="dim", highlight=False)
    table = plain_table()
    for heading in ("", "Start", "Tuned" if result.improved else "Tried"):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for name, course in result.courses.items():
        poses = name.replace("_", " ")
        table.add_row(f"{poses}: candidates; changes", str(course.candidates), str(course.changes))
        places = (0, course.draws.index(course.tried))
        table.add_row("  log score, held back", *(f"{course.losses[place]:.4g}" for place in places))
        table.add_row("  false alarms, held back", *(str(course.false_alarms[place]) for place in places))
        table.add_row("  wrong in all, held back", *(str(course.wrong[place]) for place in places))
        for fact, before, after in course.moved_weights()[:weights]:
            if before != after:
                table.add_row(f"  weight of {fact}", f"{before:+.2f}", f"{after:+.2f}")
    if result.before is not None and result.after is not None:
        scores = (result.before, result.after)
        table.add_row("segment F1 of detect, held back", *(f"{own.f1:.3f}" for own in scores))
        table.add_row("point F1 of detect, held back", *(f"{own.point_f1:.3f}" for own in scores))
        table.add_row("false segments of detect, held back", *(str(own.false_segments) for own in scores))
    print_whole(table)


def _print_mixture(result: "TuningResult") -> None:
    """The tuned settings beside what they began with, and the losses.

    Of settings that stay as they were, those that were tried.

    Args:
        result: of the tuning.
    """
    from gmmjax.tuning import STOPS

    console = Console()
    verdict = "Tuned" if result.improved else "The settings stay as they were: no better ones were found"
    console.print(verdict, style="bold", highlight=False)
    console.print(f"{result.state.steps} steps: {STOPS[result.stopped]}", style="dim", highlight=False, soft_wrap=True)
    table = plain_table()
    for heading in ("", "Start", "Tuned" if result.improved else "Tried"):
        table.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
    for number, name in enumerate(result.parameters):
        table.add_row(name, f"{result.state.values[0, 0, number]:.4g}", f"{result.tuned[name]:.4g}")
    for label, before, best in zip(("all pairs", "trained on", "held back"), result.baseline, result.best, strict=True):
        table.add_row(f"loss ({result.loss}), {label}", f"{before:.4g}", f"{best:.4g}")
    if result.f1_before is not None and result.f1_after is not None:
        for label, own, tuned in zip(("segment F1", "point F1"), result.f1_before, result.f1_after, strict=True):
            table.add_row(f"{label} of detect, all pairs", f"{own:.3f}", f"{tuned:.3f}")
    print_whole(table)


def print_next_command(command: str) -> None:
    """What to type next."""
    print_text(f"  {command}", style="dim")


def print_tuning_json(result: "TuningResult | VerdictResult") -> None:
    """The result of a tuning as JSON, on standard output."""
    print(json.dumps(result.to_dict(), indent=2, allow_nan=False))


def print_failures(failures: "Sequence[Failure]") -> None:
    """What of an evaluation failed on standard error: a line for each reason and detector."""
    alike: dict[tuple[str | None, str], list[str]] = {}
    for failure in failures:
        alike.setdefault((failure.detector, " ".join(failure.message.split())), []).append(failure.pair)
    for (detector, message), pairs in alike.items():
        more = f" and {len(pairs) - 1} more" if len(pairs) > 1 else ""
        who = f"{detector} on " if detector else ""
        print_message(f"failed: {who}{pairs[0]}{more}: {message}")


def print_report_hint(report: Path) -> None:
    """How to look at the report."""
    address = report.resolve().as_uri()
    Console().print(f"\nOpen [link={address}]{escape(address)}[/link] in a browser.", highlight=False, soft_wrap=True)


def _shown(name: object) -> str:
    """A name or a path as text for the terminal: no markup, and no character that controls it."""
    return escape(printable(str(name)))


def _table(changes: Changes, width: int) -> Table:
    """The objects that changed, without the columns that the terminal is too narrow for; the files have them all."""
    rows = object_rows(changes)
    columns = {
        name: [heading, *cells]
        for name, heading, *cells in zip(HEADINGS, headings(changes), *(row.cells for row in rows), strict=True)
    }
    columns["Probability"][0] = "Prob."
    columns["Kind"][1:] = [f"● {text}" for text in columns["Kind"][1:]]
    columns["Size"] = [text.replace(" × ", "×") for text in columns["Size"]]
    for name in ("Points", "Size", "Volume", "Centre"):
        needed = sum(max(map(len, texts)) + GAP for texts in columns.values()) - GAP
        if needed > width or not any(columns[name][1:]):
            del columns[name]
    table = plain_table()
    for name, texts in columns.items():
        table.add_column(escape(texts[0]), justify="left" if name in ("Label", "Kind") else "right", no_wrap=True)
    for number, row in enumerate(rows, start=1):
        style = KIND_COLORS[row.kind]
        label, kind, *others = (escape(texts[number]) for texts in columns.values())
        table.add_row(f"[{style}]{label}[/]", f"[{style}]{kind}[/]", *others)
    return table


def plain_table() -> Table:
    """A table without lines."""
    return Table(box=None, header_style="dim", padding=(0, GAP, 0, 0), pad_edge=False)


def print_whole(table: Table) -> None:
    """Prints a table as wide as it is: where the terminal is narrower its lines wrap, and no figure is cut off."""
    console = Console()
    natural = console.measure(table, options=console.options.update(max_width=10_000)).maximum
    Console(width=max(console.width, natural)).print(table)
