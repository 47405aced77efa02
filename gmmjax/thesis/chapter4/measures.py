"""Accuracy, precision, recall and F1 as the cells of a table, and the algorithm of the thesis as it was published."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from gmmjax.changes import DetectionConfig, detect_changes
from gmmjax.evaluation.detectors import Detection
from gmmjax.evaluation.labelled_pair import LabelledPair
from gmmjax.thesis.chapter4.accuracy import Confusion
from gmmjax.thesis.chapter4.records import Cell, Outcome

Kind = Literal["appeared", "disappeared"]
KINDS: tuple[Kind, ...] = ("appeared", "disappeared")
MEASURES = ("accuracy", "precision", "recall", "f1")
COUNTS = ("true_positives", "false_positives", "found", "missed", "true_negatives")
# The rows of the thesis's own numbers, and of its algorithm run here.
THESIS, PUBLISHED = "thesis", "published"


def single_run(pair: LabelledPair, kind: Kind, config: DetectionConfig) -> Detection:
    """One run of Algorithm 1 for one kind of change, as the thesis runs it: one fit of either cloud, no vote.

    For disappearances the clouds change places (section 4.5.1).

    Args:
        pair: the clouds.
        kind: of change that is looked for.
        config: settings but for the method, the kind and the restarts.
    """
    settings = {**config.to_dict(), "method": "greedy", "kinds": kind, "restarts": 1}
    changes = detect_changes(pair.before.points, pair.after.points, config=DetectionConfig.from_dict(settings))
    return Detection(changes.labels_before, changes.labels_after)


def published(
    pair: LabelledPair, kinds: Sequence[Kind] = KINDS, config: DetectionConfig = DetectionConfig()
) -> Detection:
    """The published algorithm: a single run for each kind of change that it is told to look for.

    Args:
        pair: the clouds.
        kinds: of change; for both there are two runs, neither of which sees what the other one removed.
        config: settings but for the method, the kind and the restarts.
    """
    labels_before, labels_after = (np.full(len(cloud.points), -1) for cloud in (pair.before, pair.after))
    for kind in kinds:
        found = single_run(pair, kind, config)
        if kind == "appeared":
            labels_after = found.labels_after
        else:
            labels_before = found.labels_before
    return Detection(labels_before, labels_after)


def confusion_of(outcomes: Sequence[Outcome], name: str = "all") -> Confusion:
    """The counts of that name in the results, added."""
    return sum((Confusion(**outcome.result[name]) for outcome in outcomes), Confusion())


def measured(outcomes: Sequence[Outcome]) -> dict[str, Cell]:
    """How many pairs there are, the four measures of all of them together, and the counts that these are made of."""
    counts = confusion_of(outcomes)
    measures = {name: round(getattr(counts, name), 4) if outcomes else None for name in MEASURES}
    return {"pairs": len(outcomes), **measures, **{name: getattr(counts, name) for name in COUNTS}}


def printed(**values: float) -> dict[str, Cell]:
    """The columns of `measured` with the numbers that the thesis gives."""
    return {"pairs": None, **{name: values.get(name) for name in MEASURES}, **dict.fromkeys(COUNTS)}


def as_text(row: Mapping[str, Any], measure: str = "f1") -> str:
    """A measure of a row as text; a dash where it is not known."""
    return "–" if row[measure] is None else f"{row[measure]:.2f}"
