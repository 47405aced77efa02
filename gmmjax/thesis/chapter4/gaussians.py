"""Figure 4.9: appearances and disappearances among five Gaussians, with low and medium overlap (thesis 4.6.1)."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gmmjax.evaluation import Condition, Detector, PairSource, detector, gaussian_pair
from gmmjax.scenes import OVERLAPS
from gmmjax.thesis.chapter4.accuracy import confusion
from gmmjax.thesis.chapter4.measures import (
    CHANGE_TYPES,
    PUBLISHED,
    THESIS,
    ChangeType,
    as_text,
    measured,
    printed,
    published,
)
from gmmjax.thesis.chapter4.records import Cell, Headline, LastPair, Outcome, Plan, Table, Unit, Work

PART = "gaussians"
METHODS = ("joint", "transport", PUBLISHED)
NUMBERS = ((1, 0), (2, 0), (0, 1), (0, 2), (1, 1))
CONDITIONS = tuple(Condition(*numbers, overlap) for numbers in NUMBERS for overlap in OVERLAPS)
ONE_KIND, BOTH_KINDS = "one kind", "both kinds"
THESIS_F1 = {ONE_KIND: 0.80, BOTH_KINDS: 0.52}


def work(plan: Plan) -> Work:
    """Every method on every pair. Only the published algorithm is told which types of change occur."""
    load, units = LastPair(), []
    for condition in CONDITIONS:
        kinds = _kinds(condition)
        for seed in plan.seeds(plan.trials):
            source = PairSource(f"seed {seed}", PART, str(condition), functools.partial(gaussian_pair, condition, seed))
            for method in METHODS:
                settings = {"kinds": kinds, "restarts": 1} if method == PUBLISHED else {}
                detect = functools.partial(published, kinds=kinds) if method == PUBLISHED else detector(method)
                run = functools.partial(_run, load, source, detect)
                units.append(Unit(PART, str(condition), seed, method, settings, run))
    return Work(units)


def tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """A row for each method and condition, then for all conditions with one type and with both, then the thesis's."""
    rows: list[dict[str, Cell]] = []
    for method in METHODS:
        own = [outcome for outcome in outcomes if outcome.method == method]
        for condition in CONDITIONS:
            among = [outcome for outcome in own if outcome.condition == str(condition)]
            rows.append({"method": method, "condition": str(condition), **measured(among)})
        for name, conditions in _groups().items():
            among = [outcome for outcome in own if outcome.condition in conditions]
            rows.append({"method": method, "condition": name, **measured(among)})
    rows += [{"method": THESIS, "condition": name, **printed(f1=value)} for name, value in THESIS_F1.items()]
    return [Table("4.9", "artificial data from five Gaussians", tuple(rows))]


def headlines(outcomes: Sequence[Outcome]) -> list[Headline]:
    """F1 over the conditions with one type of change, and with both."""
    (table,) = tables(outcomes)
    return [
        Headline("4.9", f"F1, {row['condition']} of change", str(row["method"]), as_text(row), f"{value:.2f}")
        for name, value in THESIS_F1.items()
        for row in table.rows
        if row["condition"] == name and row["method"] != THESIS
    ]


def _kinds(condition: Condition) -> tuple[ChangeType, ...]:
    numbers = {"appeared": condition.appeared, "disappeared": condition.disappeared}
    return tuple(kind for kind in CHANGE_TYPES if numbers[kind])


def _groups() -> Mapping[str, list[str]]:
    """The conditions with one type of change, and those with both."""
    return {
        name: [str(condition) for condition in CONDITIONS if len(_kinds(condition)) == number]
        for number, name in enumerate((ONE_KIND, BOTH_KINDS), start=1)
    }


def _run(load: Callable[[PairSource], Any], source: PairSource, detect: Detector) -> dict[str, Any]:
    pair = load(source)
    detection = detect(pair)
    return {"all": dataclasses.asdict(confusion(pair, detection.labels_before, detection.labels_after))}
