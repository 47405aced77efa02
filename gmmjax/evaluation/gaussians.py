"""The artificial scenes of thesis 4.6.1, detected and scored: one row for each method and condition."""

import csv
import dataclasses
import io
import json
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np

from gmmjax.changes import Changes, DetectionConfig, detect_changes
from gmmjax.changes.config import Method
from gmmjax.evaluation.scores import Scores, score_pair
from gmmjax.scenes import OVERLAPS, GaussianScene, Overlap, random_scene


@dataclasses.dataclass(frozen=True)
class Condition:
    """What changes in a scene.

    Attributes:
        appeared: new Gaussians.
        disappeared: Gaussians that are gone.
        overlap: of the Gaussians.
    """

    appeared: int
    disappeared: int
    overlap: Overlap

    def __str__(self) -> str:
        """As in the thesis: (-1 +1) low."""
        parts = [f"-{self.disappeared}"] * (self.disappeared > 0) + [f"+{self.appeared}"] * (self.appeared > 0)
        return f"({' '.join(parts) or 'none'}) {self.overlap}"


# The conditions of figure 4.9.
CONDITIONS: tuple[Condition, ...] = tuple(
    Condition(appeared, disappeared, overlap)
    for appeared, disappeared in ((1, 0), (2, 0), (0, 1), (0, 2), (1, 1))
    for overlap in OVERLAPS
)


@dataclasses.dataclass(frozen=True)
class Row:
    """The result of one method under one condition.

    Attributes:
        method: the detection method.
        condition: what changed.
        scenes: how many scenes were scored.
        right_components: share of all fits, restarts included, that found the true number of Gaussians.
        scores: summed over the scenes.
        seconds: median time of a detection, compilation of the first left out where there are more.
    """

    method: Method
    condition: Condition
    scenes: int
    right_components: float
    scores: Scores
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """The row as plain values, for tables."""
        return {
            "method": self.method,
            "condition": str(self.condition),
            "scenes": self.scenes,
            "right_components": round(self.right_components, 4),
            "precision": round(self.scores.precision, 4),
            "recall": round(self.scores.recall, 4),
            "f1": round(self.scores.f1, 4),
            "point_f1": round(self.scores.point_f1, 4),
            "false_segments": self.scores.false_segments,
            "seconds": round(self.seconds, 3),
        }


def evaluate_gaussians(
    methods: Sequence[Method],
    seeds: Sequence[int],
    *,
    conditions: Sequence[Condition] = CONDITIONS,
    config: DetectionConfig | None = None,
    points: int = 1000,
    progress: Callable[[str, float], None] | None = None,
) -> list[Row]:
    """Detects and scores random scenes of five Gaussians.

    Args:
        methods: detection methods.
        seeds: one scene of every condition for each seed; all methods see the same scenes.
        conditions: what changes; default those of figure 4.9.
        config: further settings of the detection.
        points: points drawn from each Gaussian.
        progress: called with the condition and the share of the work that is done.

    Returns:
        A row for each method and condition.
    """
    cells = [(method, condition) for method in methods for condition in conditions]
    rows = []
    for index, (method, condition) in enumerate(cells):
        if progress is not None:
            progress(f"{method} {condition}", index / len(cells))
        outcomes = list(_outcomes(method, condition, seeds, config, points))
        rows.append(_row(method, condition, outcomes))
    return rows


@dataclasses.dataclass(frozen=True)
class _Outcome:
    scores: Scores
    right_components: list[bool]
    seconds: float


def _outcomes(
    method: Method, condition: Condition, seeds: Sequence[int], config: DetectionConfig | None, points: int
) -> Iterator[_Outcome]:
    for seed in seeds:
        scene = random_scene(
            jax.random.key(seed),
            appeared=condition.appeared,
            disappeared=condition.disappeared,
            overlap=condition.overlap,
            points=points,
        )
        start = time.perf_counter()
        changes = detect_changes(scene.before, scene.after, method=method, config=config)
        seconds = time.perf_counter() - start
        scores = score_pair(changes.labels_before, changes.labels_after, scene.truth_before, scene.truth_after)
        yield _Outcome(scores, _right_components(changes, scene), seconds)


def _right_components(changes: Changes, scene: GaussianScene) -> list[bool]:
    """For each fit of either cloud whether it found the true number of Gaussians."""
    true_numbers = {"before": len(scene.mixture_before.weights), "after": len(scene.mixture_after.weights)}
    return [
        found == number for name, number in true_numbers.items() for found in changes.diagnostics[name]["components"]
    ]


def _row(method: Method, condition: Condition, outcomes: Sequence[_Outcome]) -> Row:
    right = [right for outcome in outcomes for right in outcome.right_components]
    return Row(
        method=method,
        condition=condition,
        scenes=len(outcomes),
        right_components=float(np.mean(right)),
        scores=sum((outcome.scores for outcome in outcomes), Scores()),
        seconds=float(np.median([outcome.seconds for outcome in outcomes[1:] or outcomes])),
    )


def summary(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """For each method the F1 over its scenes with one kind of change, with both, and the share of right fits."""
    summaries = {}
    for method in dict.fromkeys(row.method for row in rows):
        own = [row for row in rows if row.method == method]
        mixed = [row for row in own if row.condition.appeared and row.condition.disappeared]
        one_kind = [row for row in own if row not in mixed]
        summaries[str(method)] = {
            "f1_one_kind": sum((row.scores for row in one_kind), Scores()).f1,
            "f1_mixed": sum((row.scores for row in mixed), Scores()).f1,
            "right_components": float(np.mean([row.right_components for row in own])),
        }
    return summaries


def to_markdown(rows: Sequence[Row]) -> str:
    """The rows as a table for the documents."""
    lines = [
        "| method | condition | scenes | K right | precision | recall | F1 | point F1 | seconds |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        scores = row.scores
        figures = (row.right_components, scores.precision, scores.recall, scores.f1, scores.point_f1)
        cells = [row.method, str(row.condition), str(row.scenes), *(f"{figure:.3f}" for figure in figures)]
        lines.append(f"| {' | '.join([*cells, f'{row.seconds:.2f}'])} |")
    return "\n".join(lines) + "\n"


def to_csv(rows: Sequence[Row]) -> str:
    """The rows as comma-separated values with a header."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0].to_dict()), lineterminator="\n")
    writer.writeheader()
    writer.writerows(row.to_dict() for row in rows)
    return text.getvalue()


def to_json(rows: Sequence[Row]) -> str:
    """The rows and their summary as JSON."""
    return json.dumps({"rows": [row.to_dict() for row in rows], "summary": summary(rows)}, indent=2)
