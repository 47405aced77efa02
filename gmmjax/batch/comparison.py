"""What the history of objects needs of one finished pair of a series: its changes and their points, not the clouds."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int

from gmmjax.changes import Change, Changes, Registration
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.geometry import evenly_chosen
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class ComparisonSettings:
    """How much of a pair is kept.

    Attributes:
        change_points: most points that are kept of each change, evenly chosen of its points in their order. 1,000 are
            some 3 cm apart on a surface of a square metre, and take 24 kB. Fewer: points are so far apart that
            neighbouring objects count as one place; far more: memory, and the same links.
        coverage_points: most points of each cloud that tell which places the other survey observed; none are kept of a
            cloud that was observed completely. Fewer: the edge of what was observed is blurred by their spacing. 0: all
            places count as observed, and an object that was out of sight as gone.
    """

    change_points: int = 1000
    coverage_points: int = 4000

    def __post_init__(self) -> None:
        if self.change_points < 1:
            raise InputError(f"change_points {self.change_points} must be at least 1")
        if self.coverage_points < 0:
            raise InputError(f"coverage_points {self.coverage_points} must not be negative")


@dataclasses.dataclass(frozen=True, eq=False)
class Coverage:
    """Which places of one cloud of a pair the other survey observed.

    Attributes:
        points: of the cloud, in the frame of the before cloud; none where the other survey observed all of it.
        unobserved: per point whether the other survey did not observe its place.
    """

    points: Float[np.ndarray, "n 3"]
    unobserved: Bool[np.ndarray, " n"]

    @classmethod
    def complete(cls) -> "Coverage":
        """Of a cloud that the other survey observed completely."""
        return cls(np.empty((0, 3)), np.empty(0, bool))

    @classmethod
    def of(cls, points: Float[np.ndarray, "n 3"], unobserved: Bool[np.ndarray, " n"], most: int) -> "Coverage":
        """That of a cloud, of so many points at most.

        Args:
            points: of the cloud, in the frame of the before cloud.
            unobserved: per point whether the other survey did not observe its place.
            most: number of points that are kept.
        """
        if not most or not unobserved.any():
            return cls.complete()
        kept = _thinned(np.arange(len(points)), most)
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
    coverage: Pair[Coverage] = dataclasses.field(default_factory=lambda: Pair(Coverage.complete(), Coverage.complete()))

    @classmethod
    def of(
        cls,
        before_epoch: int,
        after_epoch: int,
        changes: Changes,
        clouds: Pair[PointCloud],
        settings: ComparisonSettings = ComparisonSettings(),
    ) -> "Comparison":
        """What is kept of a pair.

        Args:
            before_epoch: index of the epoch of the before cloud.
            after_epoch: index of that of the after cloud.
            changes: what was found in the pair.
            clouds: both, as they were given to the detection: the after cloud is not registered.
            settings: how much is kept.

        Raises:
            InputError: epochs in the wrong order, or changes of other clouds.
        """
        epochs = Pair(before_epoch, after_epoch)
        labels = Pair(changes.labels_before, changes.labels_after)
        _check(epochs, labels, clouds)
        registered = Pair(clouds.before.points, changes.registration.apply(clouds.after.points))
        unobserved = Pair(changes.unobserved_before, changes.unobserved_after)
        found = [
            _points_of(index, change, labels, registered, settings.change_points)
            for index, change in enumerate(changes)
        ]
        return cls(
            epochs=epochs,
            changes=changes.items,
            registration=changes.registration,
            sides=tuple(side for side, _ in found),
            points=tuple(points for _, points in found),
            coverage=each(
                lambda points, hidden: Coverage.of(points, hidden, settings.coverage_points), registered, unobserved
            ),
        )


def _points_of(
    index: int, change: Change, labels: Pair[Int[np.ndarray, " _"]], clouds: Pair[Float[np.ndarray, "_ 3"]], most: int
) -> tuple[int, Float[np.ndarray, "_ 3"]]:
    """The side of a change and its points; its mean where no point has its label."""
    rows = each(lambda own, cloud: np.flatnonzero(own == index), labels, clouds)
    kinds = {"disappeared": 0, "appeared": 1}
    side = kinds.get(change.kind, int(len(rows.after) > len(rows.before)))
    own, cloud = (rows.after, clouds.after) if side else (rows.before, clouds.before)
    return side, cloud[_thinned(own, most)] if len(own) else change.mean[None]


def _thinned(rows: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " m"]:
    return rows if len(rows) <= most else rows[evenly_chosen(len(rows), most)]


def _check(epochs: Pair[int], labels: Pair[Int[np.ndarray, " _"]], clouds: Pair[PointCloud]) -> None:
    if not 0 <= epochs.before < epochs.after:
        raise InputError(
            f"epochs {epochs.before} and {epochs.after}: the before cloud must be of an earlier epoch, counted from 0"
        )
    for time, label, cloud in zip(("before", "after"), labels, clouds, strict=True):
        if len(label) != len(cloud):
            raise InputError(
                f"{time}: has {len(cloud)} points, the changes have labels for {len(label)}; "
                "pass the cloud that was compared"
            )
