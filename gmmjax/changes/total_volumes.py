"""How much was gained and lost between two scans in all."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from gmmjax.changes.change import Change


class VolumeTotals(NamedTuple):
    """What was gained and lost, in the cube of the unit of the clouds, with the half-widths of the 95 % intervals.

    The registration error is common to all changes and adds up; the rest of their errors is independent.

    Attributes:
        gained: the volume of all that there is more of.
        gained_error: half-width of its interval.
        lost: the volume of all that there is less of, not negative.
        lost_error: likewise.
        net: what was gained without what was lost.
        net_error: likewise.
    """

    gained: float
    gained_error: float
    lost: float
    lost_error: float
    net: float
    net_error: float

    def to_dict(self) -> dict[str, Any]:
        """The totals by name."""
        return self._asdict()


def volume_totals(changes: "Sequence[Change]") -> VolumeTotals:
    """The sums over changes. An object that moved is lost in one place and gained in the other.

    Args:
        changes: those without a volume count for nothing.
    """
    measured = [change for change in changes if change.volume is not None]
    gains = [change for change in measured if change.gain_or_loss == "gain"]
    losses = [change for change in measured if change.gain_or_loss == "loss"]
    gained, lost = (sum(change.volume or 0.0 for change in own) for own in (gains, losses))
    return VolumeTotals(gained, _error(gains), lost, _error(losses), gained - lost, _error(measured))


def _error(changes: "Sequence[Change]") -> float:
    total = np.array([change.volume_error or 0.0 for change in changes])
    common = np.array([change.volume_registration_error or 0.0 for change in changes])
    return float(np.sqrt(np.maximum(total**2 - common**2, 0).sum() + common.sum() ** 2))
