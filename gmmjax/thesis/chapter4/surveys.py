"""Figures 4.10 and 4.12: frames and maps of the laboratory, and false changes of the opposite type (4.6.2, 4.7)."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

from gmmjax.changes import DetectionConfig
from gmmjax.errors import InputError
from gmmjax.evaluation import PairSource, detector
from gmmjax.thesis.chapter4.accuracy import confusion, opposite_confusion, overlap_confusion
from gmmjax.thesis.chapter4.measures import (
    CHANGE_TYPES,
    PUBLISHED,
    THESIS,
    ChangeType,
    as_text,
    confusion_of,
    measured,
    printed,
    published,
)
from gmmjax.thesis.chapter4.records import Cell, Headline, LastPair, Outcome, Plan, Table, Unit, Work
from gmmjax.thesis.chapter4.survey_pairs import survey_sources
from gmmjax.thesis.laboratory import CLOUD_KINDS, VOXEL_SIZE, CloudKind

PART = "surveys"
METHODS = ("joint", PUBLISHED)
# The column of F1 by the thesis's counts, `overlap_confusion`.
OVERLAP = "f1_by_overlap"
THESIS_MEASURES: Mapping[CloudKind, dict[str, float]] = {
    "frame": {"f1": 0.70, "recall": 1.0},
    "volumetric": {"f1": 0.74, "precision": 0.81},
    "localised": {},
}
THESIS_OPPOSITE: Mapping[CloudKind, float] = {"frame": 0.94, "volumetric": 0.87, "localised": 0.82}


def work(plan: Plan) -> Work:
    """Both methods on every pair of every kind of survey that can be simulated here."""
    load, units, notes = LastPair(), [], []
    for kind, name in CLOUD_KINDS.items():
        seeds = plan.seeds(plan.survey_seeds)
        try:
            pairs = survey_sources(seeds, kind)
        except InputError as error:
            notes.append(f"Left out: {error}.")
            continue
        for seed, source in zip(seeds, pairs, strict=True):
            for method in METHODS:
                settings = {"voxel_size": VOXEL_SIZE, "restarts": 1} if method == PUBLISHED else {}
                run = functools.partial(_run, load, source, method)
                units.append(Unit(PART, name, seed, method, settings, run))
    return Work(units, tuple(notes))


def tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """The measures of each kind of survey and method, and the accuracy of the opposite type of change."""
    measures: list[dict[str, Cell]] = []
    opposite: list[dict[str, Cell]] = []
    for kind, name in CLOUD_KINDS.items():
        for method in METHODS:
            own = [outcome for outcome in outcomes if (outcome.condition, outcome.method) == (name, method)]
            if own:
                overlap = round(confusion_of(own, "overlap").f1, 4)
                measures.append({"data": name, "method": method, **measured(own), OVERLAP: overlap})
                opposite.append({"data": name, "method": method, **_opposite(own)})
        numbers = THESIS_MEASURES[kind]
        measures.append({"data": name, "method": THESIS, **printed(**numbers), OVERLAP: numbers.get("f1")})
        opposite.append({"data": name, "method": THESIS, **_columns(None, THESIS_OPPOSITE[kind], None, None)})
    return [
        Table("4.10", "single frames, volumetric maps, localised maps", tuple(measures)),
        Table("4.12", "accuracy of opposite change types", tuple(opposite)),
    ]


def headlines(outcomes: Sequence[Outcome]) -> list[Headline]:
    """F1 by segments and by overlap, and the accuracy of the opposite type, for each kind of survey."""
    lines = []
    measures, opposite = tables(outcomes)
    for table, measure, words in (
        (measures, "f1", "F1"),
        (measures, OVERLAP, "F1 by overlap"),
        (opposite, "accuracy", "opposite types"),
    ):
        thesis = {row["data"]: row for row in table.rows if row["method"] == THESIS}
        for row in table.rows:
            if row["method"] != THESIS:
                said = thesis[row["data"]]
                worst = "worst" if said[measure] is None else as_text(said, measure)
                what = f"{words}, {row['data']}"
                lines.append(Headline(table.figure, what, str(row["method"]), as_text(row, measure), worst))
    return lines


def _run(load: LastPair, source: PairSource, method: str) -> dict[str, Any]:
    """The confusion counts of the type of change that occurred, and of the opposite type.

    The published algorithm is told which type occurred; it is run separately for the opposite type.
    """
    pair = load(source)
    if source.condition not in CHANGE_TYPES:
        raise InputError(f"{source.label}: must be of appearances or of disappearances alone")
    occurred: ChangeType = "appeared" if source.condition == "appeared" else "disappeared"
    other: ChangeType = "disappeared" if occurred == "appeared" else "appeared"
    if method == PUBLISHED:
        config = DetectionConfig(voxel_size=VOXEL_SIZE)
        found, opposite = published(pair, (occurred,), config), published(pair, (other,), config)
    else:
        found = opposite = detector(method)(pair)
    return {
        "all": dataclasses.asdict(confusion(pair, found.labels_before, found.labels_after)),
        "overlap": dataclasses.asdict(overlap_confusion(pair, found.labels_before, found.labels_after)),
        "opposite": dataclasses.asdict(
            opposite_confusion(pair, opposite.labels_before, opposite.labels_after, kind=other)
        ),
    }


def _opposite(outcomes: Sequence[Outcome]) -> dict[str, Cell]:
    counts = confusion_of(outcomes, "opposite")
    return _columns(len(outcomes), round(counts.accuracy, 4), counts.true_negatives, counts.false_positives)


def _columns(
    pairs: int | None, accuracy: float, true_negatives: int | None, false_positives: int | None
) -> dict[str, Cell]:
    return {
        "pairs": pairs,
        "accuracy": accuracy,
        "true_negatives": true_negatives,
        "false_positives": false_positives,
    }
