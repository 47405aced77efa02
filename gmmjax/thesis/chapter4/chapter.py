"""The parts of chapter 4, run unit by unit."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

from gmmjax.errors import ComputationError, InputError
from gmmjax.evaluation import Failure
from gmmjax.thesis.chapter4 import clustering, filtering, gaussians, grid, surveys
from gmmjax.thesis.chapter4.journal import Journal
from gmmjax.thesis.chapter4.part_names import PARTS, PartName
from gmmjax.thesis.chapter4.records import Headline, Outcome, Plan, Table, Unit, Work


class _Part(NamedTuple):
    work: Callable[[Plan], Work]
    tables: Callable[[Sequence[Outcome]], list[Table]]
    headlines: Callable[[Sequence[Outcome]], list[Headline]]


_PARTS: dict[PartName, _Part] = {
    "grid": _Part(grid.work, grid.tables, grid.headlines),
    "clustering": _Part(clustering.work, clustering.tables, clustering.headlines),
    "filtering": _Part(filtering.work, filtering.tables, filtering.headlines),
    "gaussians": _Part(gaussians.work, gaussians.tables, gaussians.headlines),
    "surveys": _Part(surveys.work, surveys.tables, surveys.headlines),
}


@dataclasses.dataclass(frozen=True)
class PartResult:
    """The results of a part.

    Attributes:
        name: of the part.
        tables: the numbers of its figures.
        headlines: its lines of the summary.
        outcomes: the results of its units, for the pictures.
        notes: on what could not be run here.
    """

    name: PartName
    tables: tuple[Table, ...]
    headlines: tuple[Headline, ...]
    outcomes: tuple[Outcome, ...]
    notes: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class ThesisResults:
    """The results of the chapter.

    Attributes:
        plan: extent of the run.
        parts: the requested parts, and those that are complete from earlier runs.
        failures: units that failed; they are left out, and run again the next time.
    """

    plan: Plan
    parts: tuple[PartResult, ...]
    failures: tuple[Failure, ...]


def run_chapter(
    plan: Plan,
    parts: Sequence[PartName],
    journal: Journal,
    *,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> ThesisResults:
    """Runs the units that are not in the journal yet, and collects the results.

    Args:
        plan: extent of the run.
        parts: parts of the chapter to run.
        journal: of this run; each result is added as soon as it is computed.
        progress: called with a description of the current unit and the fraction of the units that are done.

    Raises:
        ComputationError: every unit failed.
    """
    works = {name: part.work(plan) for name, part in _PARTS.items()}
    units = [unit for name in PARTS if name in parts for unit in works[name].units]
    missing = [unit for unit in units if unit not in journal]
    failures = []
    for number, unit in enumerate(missing, start=len(units) - len(missing)):
        progress(f"{unit.part}: {unit.label}, {unit.method}", number / len(units))
        failure = _run(unit, journal)
        failures += [failure] if failure else []
    if units and len(failures) == len(units):
        raise ComputationError(f"nothing could be run: {failures[0]}")
    shown = [name for name in PARTS if name in parts or _is_complete(works[name], journal)]
    results = tuple(_result(name, works[name], journal) for name in shown)
    return ThesisResults(plan, results, tuple(failures))


def _run(unit: Unit, journal: Journal) -> Failure | None:
    try:
        result = unit.run()
    # A failure of one unit must not prevent the others.
    except Exception as error:
        kind = "" if isinstance(error, InputError | ComputationError) else f"{type(error).__name__}: "
        return Failure(f"{unit.part}, {unit.label}", unit.method, f"{kind}{error}")
    journal.add(unit, result)
    return None


def _is_complete(work: Work, journal: Journal) -> bool:
    return bool(work.units) and all(unit in journal for unit in work.units)


def _result(name: PartName, work: Work, journal: Journal) -> PartResult:
    outcomes = tuple(
        Outcome(unit.condition, unit.seed, unit.method, unit.settings, journal.result(unit))
        for unit in work.units
        if unit in journal
    )
    if not outcomes:
        return PartResult(name, (), (), (), work.notes)
    part = _PARTS[name]
    return PartResult(name, tuple(part.tables(outcomes)), tuple(part.headlines(outcomes)), outcomes, work.notes)
