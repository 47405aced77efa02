"""Measured volumes beside the true ones, and their table."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Result(NamedTuple):
    """A scene beside its truth.

    Attributes:
        kind: of change.
        seed: of the scene.
        found: whether a change was found in the place.
        ratio: measured by true volume.
        error: half-width of the interval by the true volume.
    """

    kind: str
    seed: int
    found: bool
    ratio: float = 0.0
    error: float = 0.0

    @property
    def holds(self) -> bool:
        """Whether the true volume is in the interval."""
        return abs(self.ratio - 1) <= self.error

    @property
    def close(self) -> bool:
        """Whether it is within 5 %, or the interval where that is more."""
        return abs(self.ratio - 1) <= max(self.error, 0.05)


def row(name: str, results: Sequence[Result]) -> str:
    """A row of the table."""
    found = [result for result in results if result.found]
    if not found:
        return f"| {name} | {len(results)} | 0 | | | | | |"
    errors = np.array([abs(result.ratio - 1) for result in found])
    cells = [
        name,
        str(len(results)),
        str(len(found)),
        f"{100 * np.median(errors):.1f} %",
        f"{100 * np.mean([result.ratio - 1 for result in found]):+.1f} %",
        f"{100 * np.median([result.error for result in found]):.1f} %",
        f"{100 * np.mean([result.close for result in found]):.0f} %",
        f"{100 * np.mean([result.holds for result in found]):.0f} %",
    ]
    return f"| {' | '.join(cells)} |"


def table(results: Sequence[Result]) -> str:
    """The results of each kind, and of all."""
    lines = [
        "| change | scenes | found | median error | mean error | half-width | within 5 % or it | interval holds |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind in dict.fromkeys(result.kind for result in results):
        lines.append(row(kind, [result for result in results if result.kind == kind]))
    return "\n".join([*lines, row("all", results)])
