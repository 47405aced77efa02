"""The scores of an evaluation as lines for a terminal, as many figures as fit."""

from collections.abc import Sequence

from gmmjax.evaluation import Evaluation, cells, sections

# Shorter than those of the documents, in their order.
HEADINGS = ("", "pairs", "prec.", "recall", "F1", "pt pr.", "pt rec.", "pt F1", "false", "moved", "s")
# What a narrow terminal does not have.
WIDE_ONLY = frozenset({"pt pr.", "pt rec."})
NOTES = {
    "pt F1": "over points; the others are over segments",
    "false": "segments found where nothing had changed / such pairs",
    "moved": "objects recognised as moved / that moved, + others taken for moved",
    "s": "median seconds a pair",
}
GAP = "  "


def evaluation_lines(evaluation: Evaluation, width: int) -> list[tuple[str, str]]:
    """The lines, each with its style.

    Args:
        evaluation: at least one row.
        width: of the terminal, characters.
    """
    parts = [(heading, [cells(row) for row in rows]) for heading, rows in sections(evaluation)]
    rows = [row for _, own in parts for row in own]
    widths = {
        column: max(len(heading), *(len(row[column]) for row in rows))
        for column, heading in enumerate(HEADINGS)
        if any(row[column] for row in rows)
    }
    if sum(widths.values()) + len(GAP) * (len(widths) - 1) > width:
        widths = {column: own for column, own in widths.items() if HEADINGS[column] not in WIDE_ONLY}

    def aligned(values: Sequence[str]) -> str:
        first, *others = widths
        figures = (values[column].rjust(widths[column]) for column in others)
        return GAP.join([values[first].ljust(widths[first]), *figures]).rstrip()

    lines = [(aligned(HEADINGS), "dim")]
    for heading, own in parts:
        lines += [(heading, "bold"), *((aligned(row), "") for row in own)]
    shown = {HEADINGS[column] for column in widths}
    return lines + [(f"{heading}: {meaning}", "dim") for heading, meaning in NOTES.items() if heading in shown]
