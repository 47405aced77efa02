"""An object through the epochs of a series: where changes showed it, and in which epochs it was there."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from gmmjax.batch.comparison import Coverage
from gmmjax.batch.places import Place
from gmmjax.changes import Change
from gmmjax.geometry import transformed
from gmmjax.pair import Pair


@dataclasses.dataclass(frozen=True)
class EpochTree:
    """The epochs that can be compared with each other, directly or through others; a series has one or several.

    Attributes:
        root: the first of these epochs, in whose frame all is.
        epochs: all of them in their order.
        parents: of each epoch but the root the earlier one that it was compared with.
    """

    root: int
    epochs: tuple[int, ...]
    parents: Mapping[int, int]


class Sighting(NamedTuple):
    """A change that shows an object.

    Attributes:
        epochs: of the comparison.
        number: index of the change in it.
        change: the change.
        place: its points and box in the frame of the series.
        overlap: share of the points that the change and the object's known place have in common, 1 where that link was
            not needed.
        motion: of an object that moved in this comparison, in the frame of the series; else None.
        returned: whether the object had gone, and something of its shape is in its place again.
    """

    epochs: Pair[int]
    number: int
    change: Change
    place: Place
    overlap: float = 1.0
    motion: Float[np.ndarray, "4 4"] | None = None
    returned: bool = False


@dataclasses.dataclass(eq=False)
class Track:
    """What the comparisons say of one object.

    Attributes:
        home: where it was before the first change that shows it; None: it came.
        arrivals: by epoch, what shows the object where it had not been in the epoch compared with.
        departures: by epoch, what shows that it is no longer where it had been.
        there: whether it was there, in the epochs for which a change says so.
    """

    home: Place | None = None
    arrivals: dict[int, Sighting] = dataclasses.field(default_factory=dict)
    departures: dict[int, Sighting] = dataclasses.field(default_factory=dict)
    there: dict[int, bool] = dataclasses.field(default_factory=dict)

    def departs(self, sighting: Sighting) -> None:
        """Adds a change of the before cloud: the object was there, and is not any more."""
        self.departures[sighting.epochs.after] = sighting
        self.there[sighting.epochs.before] = True
        self.there[sighting.epochs.after] = False

    def arrives(self, sighting: Sighting, *, from_elsewhere: bool) -> None:
        """Adds a change of the after cloud.

        Args:
            sighting: the change.
            from_elsewhere: whether the object was in the before cloud, in another place.
        """
        self.arrivals[sighting.epochs.after] = sighting
        self.there[sighting.epochs.before] = from_elsewhere
        self.there[sighting.epochs.after] = True

    def inherited_place(self, epoch: int, tree: EpochTree) -> Place | None:
        """Where it is in an epoch, as the comparisons from the root to this epoch say; None: not there yet."""
        while epoch not in self.arrivals and epoch in tree.parents:
            epoch = tree.parents[epoch]
        return self.arrivals[epoch].place if epoch in self.arrivals else self.home

    def place(self, epoch: int, tree: EpochTree) -> Place:
        """Where it is in an epoch in which it is there, and else where it was or will be."""
        return self.inherited_place(epoch, tree) or self.first_place

    def latest_place(self, epoch: int) -> Place:
        """Where it was seen last, up to an epoch."""
        arrived = [other for other in self.arrivals if other <= epoch]
        return self.arrivals[max(arrived)].place if arrived else self.first_place

    @property
    def first_place(self) -> Place:
        """Its home, or where it came to."""
        return self.home if self.home is not None else self.arrivals[min(self.arrivals)].place

    def latest_sighting(self, epoch: int) -> Sighting:
        """The latest change that shows it before an epoch; the first one where none does."""
        shown = {**self.arrivals, **self.departures}
        return shown[max((other for other in shown if other < epoch), default=min(shown))]

    def presence(self, tree: EpochTree, unobserved: Iterable[int]) -> dict[int, bool | None]:
        """Of each epoch whether the object was there; None where that is not known.

        What a change says of two epochs holds for all that were compared with them without a change of the object, as
        far as its place was observed. Where two changes contradict each other, one between them was not found, and it
        is not known when.
        """
        hidden = set(unobserved) - set(self.there)
        said = {epoch: {self.there[epoch]} if epoch in self.there else set() for epoch in tree.epochs}
        free = [epoch for epoch in tree.epochs if epoch not in self.there and epoch not in hidden]
        open_ends = set(free)
        for epoch in reversed(tree.epochs[1:]):
            if tree.parents[epoch] in open_ends:
                said[tree.parents[epoch]] |= said[epoch]
        for epoch in free:
            if epoch in tree.parents:
                said[epoch] |= said[tree.parents[epoch]]
        return {epoch: next(iter(values)) if len(values) == 1 else None for epoch, values in said.items()}


def not_observed(
    places: Sequence[Place], coverage: Coverage, frame: Float[np.ndarray, "4 4"], most: float
) -> Bool[np.ndarray, " p"]:
    """Which places a survey did not observe: the nearest points of the other cloud were not observed, for most of it.

    Args:
        places: in the frame of the series.
        coverage: of the other cloud by the survey.
        frame: rigid transform of the coverage into the frame of the series.
        most: share of a place's points; it was not observed where more were not.
    """
    if not places or not len(coverage.points):
        return np.zeros(len(places), bool)
    chosen = [place.probed for place in places]
    nearest = cKDTree(transformed(coverage.points, frame)).query(np.concatenate(chosen))[1]
    hidden = np.split(coverage.unobserved[nearest], np.cumsum([len(points) for points in chosen])[:-1])
    return np.array([bool(own.mean() > most) for own in hidden])
