"""The figures of one kind of scene: a line for each detector."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from gmmjax.evaluation import Evaluation, Row, Scores
from tests.benchmarks.held_out.kinds import CHANGED, UNCHANGED
from tests.benchmarks.held_out.records import MotionError

HEADINGS = (
    "kind, poses",
    "detector",
    "segment F1 / point F1",
    "false in changed",
    "false in unchanged",
    "moved found, + false",
    "motions off by (median)",
    "seconds",
)


@dataclasses.dataclass(frozen=True)
class Line:
    """What one detector found in the scenes of one kind.

    Attributes:
        group: the kind, and whether poses were given.
        detector: its name, with its setting where that was chosen.
        changed: scores over the scenes that changed.
        unchanged: over those that did not.
        seconds: median time of a detection; None: not taken.
        failed: pairs without a result.
        motions: errors of the motions that were found.
    """

    group: str
    detector: str
    changed: Scores
    unchanged: Scores
    seconds: float | None = None
    failed: int = 0
    motions: Sequence[MotionError] = ()

    @property
    def goodness(self) -> tuple[float, float]:
        """F1 of the segments of all scenes, and that of the points: by which a setting is the best."""
        both = self.changed + self.unchanged
        return both.f1, both.point_f1

    def cells(self) -> tuple[str, ...]:
        """One for each of `HEADINGS`."""
        changed, unchanged = self.changed, self.unchanged
        moved = f"{changed.moved_found}/{changed.moved}" if changed.moved else ""
        return (
            self.group,
            self.detector + (f" ({self.failed} failed)" if self.failed else ""),
            f"{changed.f1:.2f} / {changed.point_f1:.2f}",
            f"{changed.false_segments} of {changed.segments}",
            f"{unchanged.false_in_unchanged} in {unchanged.unchanged_pairs}",
            moved
            + (
                f" +{changed.moved_false + unchanged.moved_false}"
                if changed.moved_false or unchanged.moved_false
                else ""
            ),
            self._motions(),
            "" if self.seconds is None else f"{self.seconds:.1f}",
        )

    def _motions(self) -> str:
        if not self.motions:
            return ""
        spacings, degrees = (
            np.median([getattr(own, name) for own in self.motions]) for name in ("spacings", "degrees")
        )
        return f"{spacings:.1f} spacings, {degrees:.1f}°"


def lines_of(evaluation: Evaluation, motions: Mapping[str, Sequence[MotionError]]) -> list[Line]:
    """A line for each group and detector of an evaluation.

    Args:
        evaluation: of pairs of one group.
        motions: by detector the errors of the motions that it found in them.
    """
    rows = {(row.group, row.detector, row.condition): row for row in evaluation.rows}

    def scores(total: Row, condition: str) -> Scores:
        row = rows.get((total.group, total.detector, condition))
        return row.scores if row else Scores()

    return [
        Line(
            total.group,
            total.detector,
            scores(total, CHANGED),
            scores(total, UNCHANGED),
            total.seconds,
            total.failed,
            motions.get(total.detector, ()),
        )
        for total in evaluation.totals
    ]


def to_markdown(lines: Sequence[Line]) -> str:
    """The lines as a table."""
    rows = [HEADINGS, ("---",) * len(HEADINGS), *(line.cells() for line in lines)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"
