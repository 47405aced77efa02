"""Output of the command line: progress and warnings on standard error, the answer on standard output."""

import functools
import json
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from gmmjax._messages import print_message
from gmmjax.changes import Changes
from gmmjax.errors import InputWarning, printable
from gmmjax.reporting.explanations import broken, displaced_text, explanation_lines, rejected_text
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.quantities import percent
from gmmjax.reporting.summary import (
    HEADINGS,
    answer,
    dropped_rows,
    dropped_text,
    headings,
    object_rows,
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
# A line on standard error, about the work and not about its result.
print_note = print_message
# Lines of each list of `print_batch`, and weights of each classifier of a tuning: those that say most.
MAX_PAIRS, MAX_WEIGHTS = 10, 5
# Of an evaluation, in the order of the documents' columns, which have longer ones.
SCORES = ("", "pairs", "prec.", "recall", "F1", "pt pr.", "pt rec.", "pt F1", "false", "moved", "s")
# What a narrow terminal does not have.
WIDE_ONLY = frozenset({"pt pr.", "pt rec."})
NOTES = {
    "pt F1": "over points; the others are over segments",
    "false": "segments found where nothing had changed / such pairs",
    "moved": "objects recognised as moved / that moved, + others taken for moved",
    "s": "median seconds a pair",
}


@contextmanager
def progress_bar(*, quiet: bool = False) -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar on standard error while the block runs; none if `quiet` or where that is no terminal.

    Yields:
        A function of the stage's name and the share of the whole that is done, 0 to 1; to be called from any thread.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        # A bar that is switched off prints an empty line when it ends, with most versions of rich.
        yield lambda stage, share: None
        return
    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("Starting", total=1.0)
        yield lambda stage, share: progress.update(task, description=stage, completed=share)


@contextmanager
def shown_warnings(*, quiet: bool = False) -> Iterator[None]:
    """Show each `InputWarning` as one line on standard error while the block runs, or none; others as ever."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore" if quiet else "always", InputWarning)
        warnings.showwarning = functools.partial(_show_warning, warnings.showwarning)
        yield


def _show_warning(
    show: Callable[..., None], message: Warning | str, category: type[Warning], *place: Any, **more: Any
) -> None:
    if issubclass(category, InputWarning):
        print_note(f"warning: {message}")
    else:
        show(message, category, *place, **more)


def print_changes(
    changes: Changes, *, heading: str | None = None, explain: bool = False, only: int | None = None
) -> None:
    """Print the answer, a table of the changes, and what was left out of the clouds, on standard output.

    Args:
        changes: what was found.
        heading: a line above the answer.
        explain: why they are changes, and why the rejected candidates are none; otherwise only how many these are.
        only: label of the one change that is explained; None: everything.
    """
    width = Console().width
    if heading:
        print_text(heading, "dim")
    Console().print(Text(answer(changes), "bold"))
    if changes.items:
        print_whole(_changes_table(changes, width))
    for sentence in (volumes_text, registration_text, unobserved_text, poses_text, displaced_text):
        if (text := sentence(changes)) is not None:
            print_sentence(text)
    for side, count in dropped_rows(changes).items():
        print_sentence(dropped_text(side, count))
    if explain:
        print_lines([("", ""), *explanation_lines(changes, width, only=only)])
    elif (text := rejected_text(changes)) is not None:
        print_sentence(f"{text}; --explain says why.")


def print_text(text: str, style: str = "") -> None:
    """Print a line, such as a name or a path, that the terminal takes as text whatever is in it."""
    Console().print(Text(printable(text), style), soft_wrap=True)


def print_lines(lines: Iterable[tuple[str, str]]) -> None:
    """Print lines, each with its style."""
    for text, style in lines:
        print_text(text, style)


def print_sentence(text: str) -> None:
    """Print a sentence, which the terminal breaks between words and never within an option."""
    # A number and its unit stay together: a no-break space until the lines are broken.
    text = re.sub(r"(?<=\d) (?=%|[cm]?m[²³]?\b|±)|(?<=±) ", NO_BREAK, printable(text))
    for line in broken(text, max(Console().width, 20)):
        print_text(line.replace(NO_BREAK, " "))


def _print_path(before: str, path: object, after: str = "") -> None:
    """Print a path, bold, between texts."""
    Console().print(Text.assemble(before, (printable(str(path)), "bold"), after), soft_wrap=True)


def print_json(result: "Changes | TuningResult | VerdictResult") -> None:
    """Print what a result's `to_dict` has as JSON: of changes what `changes.json` holds."""
    print(json.dumps(result.to_dict(), indent=2, allow_nan=False))


def print_files(folder: Path, description: dict[str, str]) -> None:
    """Print the files of a folder, each with what it is."""
    _print_path("\nResults in ", folder)
    width = max(len(name) for name in description)
    for name, text in description.items():
        Console().print(Text.assemble(f"  {name:<{width}}  ", (text, "dim")), soft_wrap=True)


def print_plot(path: Path | None, what: str = "Plot") -> None:
    """Print where the plot is, or another picture, if one was asked for."""
    if path is not None:
        _print_path(f"\n{what} in ", path)


def print_report_hint(report: Path) -> None:
    """Print how to look at the report."""
    address = report.resolve().as_uri()
    text = Text.assemble("\nOpen ", (address, f"link {address}"), " in a browser.")
    Console().print(text, soft_wrap=True)


def print_next_command(command: str) -> None:
    """Print what to type next."""
    print_text(f"  {command}", "dim")


def print_batch(summary: "Summary", *, heading: str | None = None) -> None:
    """Print how many pairs of a run are done and changed, those that changed most surely, and those that failed."""
    from gmmjax.reporting.batch_index import batch_answer

    if heading:
        print_text(heading, "bold")
    print_text(batch_answer(summary.pairs, summary.missing), "bold")
    changed = sorted((row for row in summary.done if row.changes), key=lambda row: -(row.highest_probability or 0))
    if changed:
        table = plain_table("Pair", "Changes", "Appeared", "Disappeared", "Moved", "Most probable", left=("Pair",))
        table.columns[0].max_width = 40
        for row in changed[:MAX_PAIRS]:
            counts = (row.changes, row.appeared, row.disappeared, row.moved)
            table.add_row(Text(printable(row.name)), *map(str, counts), percent(row.highest_probability or 0))
        Console().print(table)
    if len(changed) > MAX_PAIRS:
        print_text(f"  and {len(changed) - MAX_PAIRS} more pairs with changes", "dim")
    warned = [f"{row.name}: {'; '.join(row.warnings.splitlines())}" for row in summary.done if row.warnings]
    _print_list("with warnings", warned)
    _print_list("failed", [f"{row.name}: {row.error}" for row in summary.failed])


def _print_list(what: str, entries: Sequence[str]) -> None:
    """Print how many entries there are, and the first, each on one line unless it is a terminal, which breaks it."""
    console = Console()
    if entries:
        Console().print(f"\n{len(entries)} {what}", style="bold", highlight=False)
    for text in entries[:MAX_PAIRS]:
        for line in broken(printable(text), max(console.width, 20) if console.is_terminal else 10_000, "  ", "    "):
            print_text(line)
    if len(entries) > MAX_PAIRS:
        print_text(f"  and {len(entries) - MAX_PAIRS} more, in pairs.csv", "dim")


def print_fit(fit: "Fit", cloud: "PointCloud") -> None:
    """Print a mixture as a table."""
    mixture = fit.mixture.live_part()
    count = len(mixture.weights)
    print_text(f"{count} Gaussian{'s' * (count != 1)}", "bold")
    table = plain_table("Weight", "Mean", "Standard deviations")
    for index in np.argsort(-mixture.weights):
        deviations = np.sqrt(np.linalg.eigvalsh(mixture.covariances[index])[::-1])
        means = ", ".join(f"{value:.3f}" for value in mixture.means[index])
        table.add_row(f"{mixture.weights[index]:.3f}", means, " × ".join(f"{value:.2g}" for value in deviations))
    print_whole(table)
    if cloud.rows_dropped:
        print_text(dropped_text("given", cloud.rows_dropped))


def print_truth(scene: "SurveyedScene", changes: Changes) -> None:
    """Print the true changes of a simulated scene as a table, each with the labels it was found as."""
    from gmmjax.reporting.truth_rows import false_labels, truth_rows

    table = plain_table("Truth", "Points", "Centre", "Motion", "Found as", left=("Truth", "Motion", "Found as"))
    for row in truth_rows(scene, changes):
        centre = ", ".join(f"{value:.2f}" for value in row.centre)
        motion = "" if row.motion is None else f"{row.motion[0]:.2f} m, {row.motion[1]:.0f}°"
        found = ", ".join(map(str, row.labels)) or "not found"
        table.add_row(Text(f"● {row.kind}", KIND_COLORS[row.kind]), f"{row.points:,}", centre, motion, found)
    print_text("")
    print_whole(table)
    false = false_labels(scene, changes)
    print_text(f"False changes: {', '.join(map(str, false))}." if false else "No false changes.")


def print_topics(bag: "Bag") -> None:
    """Print the topics of a bag as a table: type, number of messages, rate and time."""
    topics = bag.topics()
    begun = f"{datetime.fromtimestamp(bag.start, UTC):%Y-%m-%d %H:%M:%S}" if topics else ""
    length = f"{bag.end - bag.start:.1f} s from {bag.start:.3f} ({begun} UTC)" if topics else "no messages"
    _print_path("", bag.path, f"  {length}")
    table = plain_table("Topic", "Type", "Messages", "Hz", "From (s)", "To (s)", left=("Topic", "Type"))
    for topic in topics:
        times = ["" if time is None else f"+{time - bag.start:.3f}" for time in (topic.start, topic.end)]
        rate = "" if topic.rate is None else f"{topic.rate:.4g}"
        names = Text(printable(topic.name)), Text(topic.type.replace("/msg/", "/"))
        table.add_row(*names, f"{topic.count:,}", rate, *times)
    print_whole(table)


def print_evaluation(evaluation: "Evaluation") -> None:
    """Print the scores: under each condition a line for each detector, and at last the sums."""
    print_lines(evaluation_lines(evaluation, Console().width))


def evaluation_lines(evaluation: "Evaluation", width: int) -> list[tuple[str, str]]:
    """Lay out the scores of an evaluation in lines with their styles, with as many columns as the width allows."""
    from gmmjax.evaluation import cells, sections

    parts = [(heading, [cells(row) for row in rows]) for heading, rows in sections(evaluation)]
    rows = [row for _, own in parts for row in own]
    widths = {
        column: max(len(heading), *(len(row[column]) for row in rows))
        for column, heading in enumerate(SCORES)
        if any(row[column] for row in rows)
    }
    if sum(widths.values()) + GAP * (len(widths) - 1) > width:
        widths = {column: own for column, own in widths.items() if SCORES[column] not in WIDE_ONLY}
    lines = [(_aligned(SCORES, widths), "dim")]
    for heading, own in parts:
        lines += [(heading, "bold"), *((_aligned(row, widths), "") for row in own)]
    shown = {SCORES[column] for column in widths}
    return lines + [(f"{heading}: {meaning}", "dim") for heading, meaning in NOTES.items() if heading in shown]


def _aligned(values: Sequence[str], widths: dict[int, int]) -> str:
    first, *others = widths
    figures = [values[first].ljust(widths[first]), *(values[column].rjust(widths[column]) for column in others)]
    return (GAP * " ").join(figures).rstrip()


def print_failures(failures: "Sequence[Failure]") -> None:
    """Print what of an evaluation failed on standard error: a line for each reason and detector."""
    alike: dict[tuple[str | None, str], list[str]] = {}
    for failure in failures:
        alike.setdefault((failure.detector, " ".join(failure.message.split())), []).append(failure.pair)
    for (detector, message), pairs in alike.items():
        more = f" and {len(pairs) - 1} more" if len(pairs) > 1 else ""
        who = f"{detector} on " if detector else ""
        print_note(f"failed: {who}{pairs[0]}{more}: {message}")


def print_tuning(result: "TuningResult | VerdictResult", settings: Path, picture: Path) -> None:
    """Print what was tuned, and what to do with the file of the settings; its course is in the picture."""
    from gmmjax.tuning import VerdictResult

    table = plain_table("", "Start", "Tuned" if result.improved else "Tried", left=("",))
    if isinstance(result, VerdictResult):
        _add_verdicts(table, result)
    else:
        _add_settings(table, result)
    print_whole(table)
    _print_path("\nSettings in ", settings, f", the course in {printable(str(picture))}")
    print_next_command(f"gmmjax detect BEFORE AFTER --out DIR --config {settings}")


def _add_verdicts(table: Table, result: "VerdictResult") -> None:
    """Print whether it is better; add how held back candidates are judged and what is detected, before and after."""
    print_text("Verdict tuned" if result.improved else "The verdict stays as it was: no better one was found", "bold")
    print_text(f"{len(result.pairs)} pairs, each held back once", "dim")
    for name, course in result.courses.items():
        poses = name.replace("_", " ")
        table.add_row(f"{poses}: candidates; changes", str(course.candidates), str(course.changes))
        places = (0, course.draws.index(course.tried))
        table.add_row("  log score, held back", *(f"{course.losses[place]:.4g}" for place in places))
        table.add_row("  false alarms, held back", *(str(course.false_alarms[place]) for place in places))
        table.add_row("  wrong in all, held back", *(str(course.wrong[place]) for place in places))
        for fact, before, after in course.moved_weights()[:MAX_WEIGHTS]:
            if before != after:
                table.add_row(f"  weight of {fact}", f"{before:+.2f}", f"{after:+.2f}")
    if result.before is not None and result.after is not None:
        scores = (result.before, result.after)
        table.add_row("segment F1 of detect, held back", *(f"{own.f1:.3f}" for own in scores))
        table.add_row("point F1 of detect, held back", *(f"{own.point_f1:.3f}" for own in scores))
        table.add_row("false segments of detect, held back", *(str(own.false_segments) for own in scores))


def _add_settings(table: Table, result: "TuningResult") -> None:
    """Print whether it is better; add the settings that were tuned or tried, and the losses, before and after."""
    from gmmjax.tuning import STOPS

    print_text("Tuned" if result.improved else "The settings stay as they were: no better ones were found", "bold")
    print_text(f"{result.state.steps} steps: {STOPS[result.stopped]}", "dim")
    for number, name in enumerate(result.parameters):
        table.add_row(name, f"{result.state.values[0, 0, number]:.4g}", f"{result.tuned[name]:.4g}")
    for label, before, best in zip(("all pairs", "trained on", "held back"), result.baseline, result.best, strict=True):
        table.add_row(f"loss ({result.loss}), {label}", f"{before:.4g}", f"{best:.4g}")
    if result.f1_before is not None and result.f1_after is not None:
        for label, own, tuned in zip(("segment F1", "point F1"), result.f1_before, result.f1_after, strict=True):
            table.add_row(f"{label} of detect, all pairs", f"{own:.3f}", f"{tuned:.3f}")


def _changes_table(changes: Changes, width: int) -> Table:
    """Make a table of the objects, without the columns that the terminal is too narrow for; the files have them all."""
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
    table = plain_table(*(texts[0] for texts in columns.values()), left=("Label", "Kind"))
    for number, row in enumerate(rows, start=1):
        label, kind, *others = (texts[number] for texts in columns.values())
        style = KIND_COLORS[row.kind]
        table.add_row(Text(label, style), Text(kind, style), *map(Text, others))
    return table


def plain_table(*headings: str, left: Collection[str] = ()) -> Table:
    """Return a table without lines, whose columns are aligned to the right but for those named in `left`."""
    table = Table(box=None, header_style="dim", padding=(0, GAP, 0, 0), pad_edge=False)
    for heading in headings:
        table.add_column(Text(heading), justify="left" if heading in left else "right", no_wrap=True)
    return table


def print_whole(table: Table) -> None:
    """Print a table as wide as it is: where the terminal is narrower its lines wrap, and no figure is cut off."""
    console = Console()
    natural = console.measure(table, options=console.options.update(max_width=10_000)).maximum
    Console(width=max(console.width, natural)).print(table)
