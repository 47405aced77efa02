"""An evaluation as a table for documents, for programs, and for spreadsheets."""

import csv
import io
import json
from collections import Counter
from collections.abc import Sequence

from gmmjax.evaluation.benchmark import Evaluation, Row

HEADINGS = (
    "detector",
    "pairs",
    "precision",
    "recall",
    "F1",
    "point precision",
    "point recall",
    "point F1",
    "false in unchanged",
    "moved",
    "seconds",
)


def cells(row: Row) -> tuple[str, ...]:
    """The figures of a row as text, one for each of `HEADINGS`.

    "false in unchanged" is false segments in pairs in which nothing changed, by their number; "moved" is moved objects
    that were recognised, of how many, and how many more were taken for moved.
    """
    scores = row.scores
    shares = (scores.precision, scores.recall, scores.f1)
    points = (scores.point_precision, scores.point_recall, scores.point_f1)
    figures = [f"{value:.3f}" if row.pairs else "" for value in (*shares, *points)]
    unchanged = f"{scores.false_in_unchanged}/{scores.unchanged_pairs}" if scores.unchanged_pairs else ""
    moved = f"{scores.moved_found}/{scores.moved}" if scores.moved or scores.moved_false else ""
    pairs = f"{row.pairs}" if not row.failed else f"{row.pairs} (-{row.failed})"
    return (
        row.detector,
        pairs,
        *figures,
        unchanged,
        moved + (f" +{scores.moved_false}" if scores.moved_false else ""),
        "" if row.seconds is None else f"{row.seconds:.2f}",
    )


def sections(evaluation: Evaluation) -> list[tuple[str, Sequence[Row]]]:
    """The rows that stand together under one heading: those of a condition, and the sums of a group of several."""
    parts: list[tuple[str, Sequence[Row]]] = []
    places = {(row.group, row.condition) for row in evaluation.rows}
    several = Counter(condition for _, condition in places)
    for group in dict.fromkeys(row.group for row in evaluation.rows):
        own = [row for row in evaluation.rows if row.group == group]
        conditions = list(dict.fromkeys(row.condition for row in own))
        for condition in conditions:
            heading = f"{condition}, {group}" if several[condition] > 1 else condition
            parts.append((heading, [row for row in own if row.condition == condition]))
        if len(conditions) > 1:
            totals = [row for row in evaluation.totals if row.group == group]
            parts.append((f"all {len(conditions)} of {group}", totals))
    return parts


def to_markdown(evaluation: Evaluation) -> str:
    """The rows and the sums as a table, with the failures below."""
    lines = [
        f"| condition | {' | '.join(HEADINGS)} |",
        f"|{'---|' * (len(HEADINGS) + 1)}",
    ]
    for heading, rows in sections(evaluation):
        lines.extend(f"| {heading} | {' | '.join(cells(row))} |" for row in rows)
    lines.extend(["", *(f"- failed: {failure}" for failure in evaluation.failures)] if evaluation.failures else [])
    return "\n".join(lines) + "\n"


def to_csv(evaluation: Evaluation) -> str:
    """The rows, without the sums, as comma-separated values with a header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(evaluation.rows[0].to_dict()), lineterminator="\n")
    writer.writeheader()
    writer.writerows(row.to_dict() for row in evaluation.rows)
    return text.getvalue()


def to_json(evaluation: Evaluation) -> str:
    """Rows, sums and failures as JSON."""
    content = {
        "rows": [row.to_dict() for row in evaluation.rows],
        "totals": [row.to_dict() for row in evaluation.totals],
        "failures": [str(failure) for failure in evaluation.failures],
    }
    return json.dumps(content, indent=2, allow_nan=False)
