"""A finished pair of a series as the history of objects needs it: its changes and their points, not the clouds."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.changes import Change, Changes, Registration
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.geometry import evenly_chosen
from gmmjax.pair import Pair, each

# Points that are kept of each change, at most: on a surface of a square metre they are some 3 cm apart, and take 24 kB.
# With fewer, neighbouring objects count as one place.
CHANGE_POINTS = 1000
# Of each cloud, to tell which places the other survey observed; with fewer the edge of these places is blurred.
COVERAGE_POINTS = 4000


@dataclasses.dataclass(frozen=True, eq=False)
class Coverage:
    """Places of one cloud of a pair that the other survey observed; by default all.

    Attributes:
        points: of the cloud, in the frame of the before cloud; none where the other survey observed all of it.
        unobserved: per point whether the other survey did not observe its place.
    """

    points: Float[np.ndarray, "n 3"] = dataclasses.field(default_factory=lambda: np.empty((0, 3)))
    unobserved: Bool[np.ndarray, " n"] = dataclasses.field(default_factory=lambda: np.empty(0, bool))

    @classmethod
    def of(cls, points: Float[np.ndarray, "n 3"], unobserved: Bool[np.ndarray, " n"]) -> "Coverage":
        """The coverage of a cloud, by a part of its points."""
        if not unobserved.any():
            return cls()
        kept = evenly_chosen(len(points), COVERAGE_POINTS)
        return cls(points[kept], unobserved[kept])


@dataclasses.dataclass(frozen=True, eq=False)
class Comparison:
    """A finished pair of a series. All coordinates are in the frame of its before cloud, as those of `Changes` are.

    Attributes:
        epochs: indices of the two epochs in the series, the earlier one first.
        changes: what was found.
        registration: of the after cloud to the before cloud.
        sides: of each change the cloud that its points are in, 0 before or 1 after.
        points: of each change its points, thinned.
        coverage: of either cloud, what the other survey observed.
    """

    epochs: Pair[int]
    changes: tuple[Change, ...]
    registration: Registration
    sides: tuple[int, ...]
    points: tuple[Float[np.ndarray, "_ 3"], ...]
    coverage: Pair[Coverage] = Pair(Coverage(), Coverage())

    @classmethod
    def of(cls, before_epoch: int, after_epoch: int, changes: Changes, clouds: Pair[PointCloud]) -> "Comparison":
        """Keep what the history needs of a pair.

        Raises:
            InputError: changes of other clouds.
        """
        labels = Pair(changes.labels_before, changes.labels_after)
        for time, label, cloud in zip(("before", "after"), labels, clouds, strict=True):
            if len(label) != len(cloud):
                raise InputError(
                    f"{time}: has {len(cloud)} points, the changes have labels for {len(label)}; "
                    "pass the cloud that was compared"
                )
        registered = Pair(clouds.before.points, changes.registration.apply(clouds.after.points))
        found = [_points_of(index, change, labels, registered) for index, change in enumerate(changes)]
        return cls(
            epochs=Pair(before_epoch, after_epoch),
            changes=changes.items,
            registration=changes.registration,
            sides=tuple(side for side, _ in found),
            points=tuple(points for _, points in found),
            coverage=each(Coverage.of, registered, Pair(changes.unobserved_before, changes.unobserved_after)),
        )


def _points_of(
    index: int, change: Change, labels: Pair[Int[np.ndarray, " _"]], clouds: Pair[Float[np.ndarray, "_ 3"]]
) -> tuple[int, Float[np.ndarray, "_ 3"]]:
    """The side of a change and its points; its mean where no point has its label."""
    rows = labels.map(lambda own: np.flatnonzero(own == index))
    kinds = {"disappeared": 0, "appeared": 1}
    side = kinds.get(change.kind, int(len(rows.after) > len(rows.before)))
    own, cloud = (rows.after, clouds.after) if side else (rows.before, clouds.before)
    return side, cloud[own[evenly_chosen(len(own), CHANGE_POINTS)]] if len(own) else change.mean[None]
