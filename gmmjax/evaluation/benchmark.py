"""Any detectors on any labelled pairs, scored: one row for each detector and condition."""

import dataclasses
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from gmmjax.errors import ComputationError, InputError, InputWarning
from gmmjax.evaluation.detectors import Detection, Detector
from gmmjax.evaluation.labelled_pair import LabelledPair, PairSource
from gmmjax.evaluation.scores import Scores, score_labelled_pair

Record = Callable[[str, LabelledPair, Detection], None]
ALL = "all"


@dataclasses.dataclass(frozen=True)
class Row:
    """The result of one detector under one condition, or over a group.

    Attributes:
        detector: its name.
        group: of the pairs.
        condition: of the pairs; "all" for the sum over a group.
        pairs: how many were scored.
        failed: how many could not be.
        scores: summed over the pairs.
        seconds: median time of a detection, compilation included where a program was compiled; None: none was done.
    """

    detector: str
    group: str
    condition: str
    pairs: int
    failed: int
    scores: Scores
    seconds: float | None

    def to_dict(self) -> dict[str, Any]:
        """The row as plain values, for tables."""
        scores = self.scores
        shares = ("precision", "recall", "f1", "point_precision", "point_recall", "point_f1")
        counts = ("segments", "changes", "false_segments", "unchanged_pairs", "false_in_unchanged", "moved")
        return {
            "detector": self.detector,
            "group": self.group,
            "condition": self.condition,
            "pairs": self.pairs,
            "failed": self.failed,
            **{name: round(getattr(scores, name), 4) for name in shares},
            **{name: getattr(scores, name) for name in (*counts, "moved_found", "moved_false", "shadow_points")},
            "seconds": None if self.seconds is None else round(self.seconds, 3),
        }


@dataclasses.dataclass(frozen=True)
class Failure:
    """A pair that could not be read, or that a detector failed on.

    Attributes:
        pair: its name, with the condition.
        detector: None where the pair could not be had at all.
        message: why.
    """

    pair: str
    detector: str | None
    message: str

    def __str__(self) -> str:
        return f"{self.pair}{f', {self.detector}' if self.detector else ''}: {self.message}"


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """The result of all detectors on all pairs.

    Attributes:
        rows: one for each condition and detector, in the order of the pairs.
        totals: one for each group and detector: the counts of its conditions added.
        failures: what is missing in them.
    """

    rows: tuple[Row, ...]
    totals: tuple[Row, ...]
    failures: tuple[Failure, ...]


@dataclasses.dataclass(frozen=True)
class _Outcome:
    detector: str
    source: PairSource
    scores: Scores | None
    seconds: float
    failure: Failure | None


def evaluate(
    detectors: Mapping[str, Detector],
    sources: Sequence[PairSource],
    *,
    progress: Callable[[str, float], None] = lambda stage, share: None,
    record: Record = lambda name, pair, detection: None,
) -> Evaluation:
    """Detects and scores.

    What fails is left out and listed: one bad pair does not lose the others.

    Args:
        detectors: by name; all see the same pairs.
        sources: the pairs, had one after the other.
        progress: called with what is being done and the share of the work that is done.
        record: called with each detection.

    Returns:
        Rows of every condition and detector, sums over the groups, and what failed.
    """
    outcomes: list[_Outcome] = []
    for index, source in enumerate(sources):
        share = index / len(sources)
        progress(source.label, share)
        try:
            pair = source.load()
        # Whatever is wrong with this pair, there are the others.
        except Exception as error:
            failure = Failure(source.label, None, _message(error))
            outcomes.extend(_Outcome(name, source, None, 0.0, failure) for name in detectors)
            continue
        for number, (name, detect) in enumerate(detectors.items()):
            progress(f"{source.label}: {name}", share + number / len(detectors) / len(sources))
            outcomes.append(_outcome(name, detect, source, pair, record))
    failures = dict.fromkeys(outcome.failure for outcome in outcomes if outcome.failure is not None)
    return Evaluation(*_rows(outcomes), tuple(failures))


def _outcome(name: str, detect: Detector, source: PairSource, pair: LabelledPair, record: Record) -> _Outcome:
    start = time.perf_counter()
    try:
        with _named_warnings(f"{source.label}, {name}"):
            detection = detect(pair)
    # Of whatever kind: some detectors are other people's.
    except Exception as error:
        failure = Failure(source.label, name, _message(error))
        return _Outcome(name, source, None, time.perf_counter() - start, failure)
    seconds = time.perf_counter() - start
    record(name, pair, detection)
    scores = score_labelled_pair(pair, detection.labels_before, detection.labels_after, detection.moved)
    return _Outcome(name, source, scores, seconds, None)


@contextmanager
def _named_warnings(label: str) -> Iterator[None]:
    """Says what an `InputWarning` that arises in the block is about."""
    with warnings.catch_warnings(record=True) as caught:
        yield
    for warning in caught:
        about = f"{label}: " if issubclass(warning.category, InputWarning) else ""
        warnings.warn_explicit(f"{about}{warning.message}", warning.category, warning.filename, warning.lineno)


def _message(error: Exception) -> str:
    kind = "" if isinstance(error, InputError | ComputationError) else f"{type(error).__name__}: "
    return f"{kind}{error}"


def _rows(outcomes: Sequence[_Outcome]) -> tuple[tuple[Row, ...], tuple[Row, ...]]:
    cells: dict[tuple[str, str, str], list[_Outcome]] = {}
    groups: dict[tuple[str, str], list[_Outcome]] = {}
    for outcome in outcomes:
        source = outcome.source
        cells.setdefault((outcome.detector, source.group, source.condition), []).append(outcome)
        groups.setdefault((outcome.detector, source.group), []).append(outcome)
    rows = tuple(_row(*cell, own) for cell, own in cells.items())
    return rows, tuple(_row(*group, ALL, own) for group, own in groups.items())


def _row(detector: str, group: str, condition: str, outcomes: Sequence[_Outcome]) -> Row:
    done = [outcome for outcome in outcomes if outcome.scores is not None]
    return Row(
        detector=detector,
        group=group,
        condition=condition,
        pairs=len(done),
        failed=len(outcomes) - len(done),
        scores=sum((outcome.scores for outcome in done if outcome.scores), Scores()),
        seconds=float(np.median([outcome.seconds for outcome in done])) if done else None,
    )
