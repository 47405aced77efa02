"""The volumes that were gained and lost between two scans in all."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from gmmjax.changes.change import Change


class VolumeTotals(NamedTuple):
    """The volumes gained and lost, in the cube of the unit of the clouds, with the half-widths of the 95 % intervals.

    The registration error is common to all changes and adds up; the rest of their errors is independent. A sum with the
    volume of a hull in it has no interval.

    Attributes:
        gained: the volume of all that there is more of.
        gained_error: half-width of its interval.
        lost: the volume of all that there is less of, not negative.
        lost_error: likewise.
        net: what was gained without what was lost.
        net_error: likewise.
        unsigned: the volume of changes of which nothing tells whether it was gained or lost; in none of the above.
        unsigned_error: likewise.
    """

    gained: float
    gained_error: float | None
    lost: float
    lost_error: float | None
    net: float
    net_error: float | None
    unsigned: float = 0.0
    unsigned_error: float | None = 0.0

    def to_dict(self) -> dict[str, Any]:
        """The totals by name."""
        return self._asdict()


def volume_totals(changes: "Sequence[Change]") -> VolumeTotals:
    """The sums over changes. An object that moved is lost in one place and gained in the other.

    Args:
        changes: those without a volume count for nothing.
    """
    measured = [volume for change in changes for volume in _volumes(change)]
    gains, losses, others = ([own for own in measured if own.gained is gained] for gained in (True, False, None))
    gained, lost, unsigned = (sum(own.volume for own in side) for side in (gains, losses, others))
    net = gained - lost, _error(gains + losses)
    return VolumeTotals(gained, _error(gains), lost, _error(losses), *net, unsigned, _error(others))


class _Volume(NamedTuple):
    """A volume, whether it was gained (None: not known), and the half-widths of its interval and of its common part."""

    gained: bool | None
    volume: float
    error: float | None
    registration_error: float | None


def _volumes(change: "Change") -> list[_Volume]:
    """The volume of a change, and that of its part that was gained where the rest was lost, or the other way round."""
    if change.volume is None:
        return []
    gained = None if change.gain_or_loss is None else change.gain_or_loss == "gain"
    found = [_Volume(gained, change.volume, change.volume_error, change.volume_registration_error)]
    if change.opposite_volume is not None:
        errors = change.opposite_volume_error, change.opposite_volume_registration_error
        found.append(_Volume(None if gained is None else not gained, change.opposite_volume, *errors))
    return found


def _error(volumes: Sequence[_Volume]) -> float | None:
    if any(own.error is None for own in volumes):
        return None
    total = np.array([own.error for own in volumes])
    common = np.array([own.registration_error or 0.0 for own in volumes])
    return float(np.sqrt(np.maximum(total**2 - common**2, 0).sum() + common.sum() ** 2))
