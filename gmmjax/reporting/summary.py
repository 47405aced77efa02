"""The answer in words and in rows, the same on the terminal and in the report."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gmmjax.changes import Change, Changes, Kind, RejectedCandidate

HEADINGS = ("Label", "Kind", "Probability", "Points", "Centre", "Size")


class ChangeRow(NamedTuple):
    """One change as text.

    Attributes:
        label: its index, which is also the label of its points in the files.
        kind: of change, without the partner.
        cells: one text for each of `HEADINGS`.
    """

    label: int
    kind: Kind
    cells: tuple[str, ...]


def answer(changes: Changes) -> str:
    """The answer in a sentence: "2 changes: 1 appeared, 1 disappeared". A moved object counts once."""
    counts = changes.object_counts()
    total = sum(counts.values())
    if total == 0:
        return "No change found"
    parts = ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)
    return f"{total} change{'s' * (total != 1)}: {parts}"


def change_rows(changes: Changes) -> list[ChangeRow]:
    """The changes as text, in their order."""
    return [ChangeRow(label, change.kind, _cells(label, change)) for label, change in enumerate(changes.items)]


def percent(probability: float) -> str:
    """A probability to whole percents; only certainty is 100 %."""
    shown = math.floor(probability * 100) if 0.99 < probability < 1 else round(probability * 100)
    return f"{shown} %"


def share(part: float) -> str:
    """A share to whole percents; "under 1 %" where there is some."""
    return "under 1 %" if 0 < part < 0.01 else percent(part)


def dropped_rows(changes: Changes) -> dict[str, int]:
    """How many rows of each cloud had NaN or infinite coordinates, for the clouds that had any."""
    sides = {side: changes.diagnostics.get(side) for side in ("before", "after")}
    counts = {side: int(found.get("rows_dropped", 0)) for side, found in sides.items() if isinstance(found, dict)}
    return {side: count for side, count in counts.items() if count}


def dropped_text(side: str, count: int) -> str:
    """What `dropped_rows` counts, in a sentence."""
    rows, were = ("row", "was") if count == 1 else ("rows", "were")
    return f"{count:,} {rows} of the {side} cloud had no finite position and {were} left out."


def unobserved_text(changes: Changes) -> str | None:
    """How much of each cloud the other survey did not see, in a sentence; None where it saw all or nothing is known."""
    shares = {"before": changes.unobserved_before.mean(), "after": changes.unobserved_after.mean()}
    parts = [f"{share(float(part))} of the {side} cloud" for side, part in shares.items() if part > 0]
    return f"Not observed by the other survey: {' and '.join(parts)}." if parts else None


def registration_text(changes: Changes) -> str | None:
    """How far the after cloud was moved and how well it fits, in a sentence; None where nothing is known."""
    registration = changes.registration
    if registration.overlap is None:
        return None
    if registration.applied:
        moved = f"{registration.displacement:.3g} and rotated by {registration.rotation_degrees:.2g}°"
        parts = [f"the after cloud was moved by {moved} onto the before cloud"]
    elif changes.config.registration == "never":
        parts = ["the clouds were compared as they are"]
    else:
        parts = ["none was needed"]
    # The residual of volumetric clouds is a standard error, and that of clouds left alone is the one before.
    if registration.residual and not changes.diagnostics.get("volumetric"):
        before = registration.residual_before
        was = f"{before:.2g} → " if registration.applied and before is not None else ""
        parts.append(f"residual {was}{registration.residual:.2g}")
    parts.append(f"overlap {percent(registration.overlap)}")
    if percent(registration.confidence) != "100 %" and registration.confidence < 0.99:
        parts.append(f"confidence {percent(registration.confidence)}")
    return f"Registration: {'; '.join(parts)}."


def place_cells(found: Change | RejectedCandidate) -> tuple[str, str, str]:
    """Number of points, centre and size, as the last three of `HEADINGS`."""
    return (f"{found.point_count:,}", *place_text(found.mean, found.box.extent))


def place_text(centre: Float[np.ndarray, "3"], extent: Float[np.ndarray, "3"]) -> tuple[str, str]:
    """A centre and a size with as many decimals as show the size."""
    digits = _decimals(extent)
    return ", ".join(f"{value:.{digits}f}" for value in centre), " × ".join(f"{value:.{digits}f}" for value in extent)


def _cells(label: int, change: Change) -> tuple[str, ...]:
    kind = change.kind if change.partner is None else f"{change.kind} (with {change.partner})"
    return str(label), kind, percent(change.probability), *place_cells(change)


def _decimals(extent: np.ndarray) -> int:
    """Decimals that show the longest edge in three digits."""
    longest = float(extent.max())
    return 3 if longest <= 0 else min(max(2 - math.floor(math.log10(longest)), 0), 9)
