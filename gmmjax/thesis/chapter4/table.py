"""A table of chapter 4, and what one part of the chapter gives."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from gmmjax.evaluation import Failure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell: TypeAlias = str | int | float | bool | None
Row: TypeAlias = Mapping[str, Cell]


class Table(NamedTuple):
    """The numbers of a figure of the thesis.

    Attributes:
        number: of the figure, such as "4.9".
        title: of the table.
        thesis: what the thesis says.
        rows: all with the same columns; None: not known.
        brief: the rows of the summary.
        figure: the rows drawn.
    """

    number: str
    title: str
    thesis: str
    rows: Sequence[Row]
    brief: Sequence[Row]
    figure: "Figure"

    def to_csv(self) -> str:
        """The rows as comma-separated values with a header."""
        text = io.StringIO()
        writer = csv.DictWriter(text, fieldnames=list(self.rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows)
        return text.getvalue()

    def to_markdown(self) -> str:
        """The rows of the summary below the figure and what the thesis says."""
        rows = [
            list(self.brief[0]),
            ["---"] * len(self.brief[0]),
            *([as_text(cell) for cell in row.values()] for row in self.brief),
        ]
        head = f"## Figure {self.number}: {self.title}\n\n![{self.title}](figure-{self.number}.png)\n\n"
        return head + f"The thesis: {self.thesis}\n\n" + "".join(f"| {' | '.join(cells)} |\n" for cells in rows)


class Part(NamedTuple):
    """The results of a part of the chapter: its tables, and what is missing in them."""

    tables: Sequence[Table]
    failures: tuple[Failure, ...] = ()
    notes: tuple[str, ...] = ()


def as_text(cell: Cell) -> str:
    """A cell as text: a dash where it is not known."""
    return "–" if cell is None else f"{cell:.2f}" if isinstance(cell, float) else str(cell)
