"""Accuracy, precision, recall and F1 as the cells of a table, and the published algorithm of the thesis."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np

from gmmjax.changes import DetectionConfig, detect_changes
from gmmjax.evaluation import Detection, LabelledPair
from gmmjax.thesis.chapter4.accuracy import Confusion
from gmmjax.thesis.chapter4.records import Cell, Outcome

ChangeType = Literal["appeared", "disappeared"]
CHANGE_TYPES: tuple[ChangeType, ...] = get_args(ChangeType)
MEASURES = ("accuracy", "precision", "recall", "f1")
COUNTS = ("true_positives", "false_positives", "found", "missed", "true_negatives")
# The methods of the rows with the thesis's numbers, and with its algorithm run here.
THESIS, PUBLISHED = "thesis", "published"


def single_run(pair: LabelledPair, kind: ChangeType, config: DetectionConfig) -> Detection:
    """One run of Algorithm 1 for one type of change, as in the thesis: one fit of each cloud, no consensus.

    For disappearances the clouds are exchanged (section 4.5.1).

    Args:
        pair: the clouds.
        kind: type of change to detect.
        config: settings; method, kinds and restarts are replaced.
    """
    settings = {**config.to_dict(), "method": "greedy", "kinds": kind, "restarts": 1}
    changes = detect_changes(pair.before.points, pair.after.points, config=DetectionConfig.from_dict(settings))
    return Detection(changes.labels_before, changes.labels_after)


def published(
    pair: LabelledPair, kinds: Sequence[ChangeType] = CHANGE_TYPES, config: DetectionConfig = DetectionConfig()
) -> Detection:
    """The published algorithm: a single run for each type of change that it is told to detect.

    Args:
        pair: the clouds.
        kinds: types of change; for both there are two independent runs.
        config: settings; method, kinds and restarts are replaced.
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
    """The sum of the counts of that name in the results."""
    return sum((Confusion(**outcome.result[name]) for outcome in outcomes), Confusion())


def measured(outcomes: Sequence[Outcome]) -> dict[str, Cell]:
    """The columns of a row: number of pairs, the four measures over all of them, and the counts behind these."""
    counts = confusion_of(outcomes)
    measures = {name: round(getattr(counts, name), 4) if outcomes else None for name in MEASURES}
    return {"pairs": len(outcomes), **measures, **{name: getattr(counts, name) for name in COUNTS}}


def printed(**values: float) -> dict[str, Cell]:
    """The columns of `measured` with the thesis's numbers; None: it gives none."""
    return {"pairs": None, **{name: values.get(name) for name in MEASURES}, **dict.fromkeys(COUNTS)}


def as_text(row: Mapping[str, Any], measure: str = "f1") -> str:
    """A measure of a row as text; a dash where it is None."""
    return "–" if row[measure] is None else f"{row[measure]:.2f}"
