"""What the parts of chapter 4 are made of: how much is run, the units of the work, and the tables that come out."""

import csv
import dataclasses
import io
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from gmmjax.evaluation.labelled_pair import LabelledPair, PairSource

Cell: TypeAlias = str | int | float | bool | None


@dataclasses.dataclass(frozen=True)
class Plan:
    """How much is run.

    Attributes:
        first_seed: of everything; the others follow on.
        clustering_seeds: clouds of four and of seven Gaussians that are clustered.
        trials: pairs of each condition of figure 4.9.
        survey_seeds: pairs of each kind of survey.
        filtering_seeds: pairs of localised maps with and without the outlier filter.
    """

    first_seed: int = 0
    clustering_seeds: int = 20
    trials: int = 10
    survey_seeds: int = 20
    filtering_seeds: int = 10

    @classmethod
    def quick(cls, first_seed: int = 0) -> "Plan":
        """A small run, of a minute or two."""
        return cls(first_seed, clustering_seeds=3, trials=1, survey_seeds=1, filtering_seeds=1)

    def seeds(self, count: int) -> range:
        """So many seeds from the first one on."""
        return range(self.first_seed, self.first_seed + count)


@dataclasses.dataclass(frozen=True)
class Unit:
    """A piece of the work whose result is kept as soon as it is there.

    Attributes:
        part: of the chapter.
        condition: what the data are.
        seed: of the data.
        method: what is done with them.
        settings: of the method, plain values.
        run: gives the result, as plain values.
    """

    part: str
    condition: str
    seed: int
    method: str
    settings: Mapping[str, Any]
    run: Callable[[], dict[str, Any]]

    @property
    def key(self) -> str:
        """What the result depends on, as JSON."""
        return json.dumps([self.part, self.condition, self.seed, self.method, self.settings], sort_keys=True)

    @property
    def label(self) -> str:
        """The data, in words."""
        return f"{self.condition}, seed {self.seed}"


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The result of a unit: the same fields, and plain values."""

    condition: str
    seed: int
    method: str
    settings: Mapping[str, Any]
    result: Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Work:
    """The units of a part, and what cannot be run here."""

    units: Sequence[Unit]
    notes: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Table:
    """The numbers of a figure.

    Attributes:
        figure: of the thesis, such as "4.9".
        title: what the numbers are.
        rows: with the same columns; None: not known.
    """

    figure: str
    title: str
    rows: tuple[Mapping[str, Cell], ...]

    @property
    def file_name(self) -> str:
        """Of the table as comma-separated values."""
        return f"figure-{self.figure}.csv"

    @property
    def columns(self) -> tuple[str, ...]:
        """The headings."""
        return tuple(self.rows[0]) if self.rows else ()

    def to_csv(self) -> str:
        """The rows as comma-separated values with a header."""
        text = io.StringIO()
        writer = csv.DictWriter(text, fieldnames=self.columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows)
        return text.getvalue()


@dataclasses.dataclass(frozen=True)
class Headline:
    """One line of the summary: what the thesis says, and what comes out here.

    Attributes:
        figure: of the thesis.
        measure: what is compared.
        method: that it was measured of here.
        here: the figure here.
        thesis: that of the thesis; empty: it gives none.
    """

    figure: str
    measure: str
    method: str
    here: str
    thesis: str


class LastPair:
    """Loads pairs, and keeps the last one: the units of one pair follow each other."""

    def __init__(self) -> None:
        self._last: tuple[PairSource, LabelledPair] | None = None

    def __call__(self, source: PairSource) -> LabelledPair:
        """The pair of a source."""
        if self._last is None or self._last[0] is not source:
            self._last = source, source.load()
        return self._last[1]
