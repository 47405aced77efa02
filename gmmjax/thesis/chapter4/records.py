"""The records of chapter 4: the extent of a run, its units of work and their outcomes, the tables made of these."""

import csv
import dataclasses
import io
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from gmmjax.evaluation import LabelledPair, PairSource

Cell: TypeAlias = str | int | float | bool | None


@dataclasses.dataclass(frozen=True)
class Plan:
    """The extent of a run.

    Attributes:
        first_seed: first seed of every experiment; the others are consecutive.
        clustering_seeds: number of clouds of four and of seven Gaussians to cluster.
        trials: number of pairs of each condition of figure 4.9.
        survey_seeds: number of pairs of each kind of survey.
        filtering_seeds: number of pairs of localised maps with and without the outlier filter.
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
        """A number of consecutive seeds from the first one on."""
        return range(self.first_seed, self.first_seed + count)


@dataclasses.dataclass(frozen=True)
class Unit:
    """A unit of work, whose result is written to the journal as soon as it is computed.

    Attributes:
        part: name of the part of the chapter.
        condition: description of the data.
        seed: of the data.
        method: name of the method that is applied to them.
        settings: of the method, as JSON values.
        run: computes the result, as JSON values.
    """

    part: str
    condition: str
    seed: int
    method: str
    settings: Mapping[str, Any]
    run: Callable[[], dict[str, Any]]

    @property
    def key(self) -> str:
        """Everything that the result depends on, as JSON."""
        return json.dumps([self.part, self.condition, self.seed, self.method, self.settings], sort_keys=True)

    @property
    def label(self) -> str:
        """The data, in words."""
        return f"{self.condition}, seed {self.seed}"


@dataclasses.dataclass(frozen=True)
class Outcome:
    """The result of a unit, as JSON values, with the unit's fields."""

    condition: str
    seed: int
    method: str
    settings: Mapping[str, Any]
    result: Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Work:
    """The units of a part, and notes on what cannot be run here."""

    units: Sequence[Unit]
    notes: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Table:
    """The numbers of a figure.

    Attributes:
        figure: number of the figure in the thesis, such as "4.9".
        title: of the table.
        rows: all with the same columns; None: not known.
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
    """One line of the summary: a result of the thesis beside that of this run.

    Attributes:
        figure: number of the figure in the thesis.
        measure: the quantity that is compared.
        method: the method that was run here.
        here: the value in this run.
        thesis: the value in the thesis; empty: it gives none.
    """

    figure: str
    measure: str
    method: str
    here: str
    thesis: str


class LastPair:
    """Loads pairs, and keeps the last one: the units of one pair are consecutive."""

    def __init__(self) -> None:
        self._last: tuple[PairSource, LabelledPair] | None = None

    def __call__(self, source: PairSource) -> LabelledPair:
        """The pair of a source."""
        if self._last is None or self._last[0] is not source:
            self._last = source, source.load()
        return self._last[1]
