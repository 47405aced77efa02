"""The interface of all detectors: two scans in, a detection out."""

import abc
import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Int

from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.progress import Progress, silent
from gmmjax.changes.record import Changes
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.pair import Pair


class Scan(NamedTuple):
    """One cloud, and where it was seen from.

    Attributes:
        cloud: coordinates [n, 3], or a `PointCloud`, in any unit.
        views: where the sensor stood, in the frame of the cloud; None: not known.
        recognised: whether nobody has told where it stood, but the cloud itself shows it.
    """

    cloud: ArrayLike | PointCloud
    views: SensorViews | None = None
    recognised: bool = False


class Detection(NamedTuple):
    """The changes that a detector finds in a pair.

    Attributes:
        labels_before: per point -1 or the number of a change.
        labels_after: the same for the after cloud.
        moved: changes of the before and of the after cloud that are reported as one object.
        changes: the full record, of detectors that have probabilities.
    """

    labels_before: Int[np.ndarray, " n0"]
    labels_after: Int[np.ndarray, " n1"]
    moved: tuple[tuple[int, int], ...] = ()
    changes: Changes | None = None


class AbstractDetector(abc.ABC):
    """Finds what changed from one scan to another. Its settings are its fields."""

    @abc.abstractmethod
    def detect(self, scans: Pair[Scan], report: Progress = silent) -> Detection:
        """Find what changed.

        Args:
            scans: at the earlier and at the later time, in one unit.
            report: called with the name of the stage and the share of the work that is done, from any thread.

        Raises:
            InputError: clouds, views or settings that cannot be used.
            ComputationError: nothing could be computed.
        """


@dataclasses.dataclass(frozen=True)
class AbstractChangeDetector(AbstractDetector):
    """A detector whose result is a full record, with probabilities.

    Attributes:
        config: what the user set; it is kept with the result.
    """

    config: DetectionConfig = DetectionConfig()

    def detect(self, scans: Pair[Scan], report: Progress = silent) -> Detection:
        """Find what changed; see `AbstractDetector`."""
        changes = self.changes(scans, report)
        return Detection(changes.labels_before, changes.labels_after, _moved(changes), changes)

    @abc.abstractmethod
    def changes(self, scans: Pair[Scan], report: Progress = silent) -> Changes:
        """The record of what changed; arguments and errors as in `detect`."""


def _moved(changes: Changes) -> tuple[tuple[int, int], ...]:
    """The moved changes of the before cloud, each with its partner in the after cloud."""
    moved = [index for index, change in enumerate(changes.items) if change.kind == "moved"]
    gone = [index for index in moved if (changes.labels_before == index).any()]
    return tuple((index, partner) for index in gone if (partner := changes.items[index].partner) is not None)
