"""Pairs of scans, made ready to be fitted again and again with other priors."""

import dataclasses
import functools
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import ArrayLike, Bool, Float, Int

from gmmjax._typing import Array
from gmmjax.changes import (
    CheckedCloud,
    DetectionConfig,
    WorkingCloud,
    aligned,
    check_overlap,
    check_pair,
    in_one_system,
    joint_problem,
    working_pair,
)
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.comparison import LabelledPoints
from gmmjax.errors import InputError
from gmmjax.mixtures import Prior, Standardisation, WeightedPoints
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True, eq=False)
class ScanPair:
    """Two scans to tune on.

    Attributes:
        name: of the pair.
        before: coordinates [n0, 3] or a `PointCloud`.
        after: coordinates [n1, 3] or a `PointCloud`, in the same unit.
        truth_before: for each point of `before` -1 unchanged, else the id of its change; None: not known.
        truth_after: the same for `after`.
        ignored_before: for each point of `before` whether it is not to be judged, such as where the other survey could
            not see; None: all are.
        ignored_after: the same for `after`.
        views_before: where the sensor stood; None: not known. The fits do without; `detect_changes`, which has the last
            word, uses them.
        views_after: the same for `after`.
        unseen_before: for each point of `before` whether the other survey could not see its place: there the verdict
            should say that it was not observed. None: not known.
        unseen_after: the same for `after`.
    """

    name: str
    before: ArrayLike | PointCloud
    after: ArrayLike | PointCloud
    truth_before: Int[np.ndarray, " n0"] | None = None
    truth_after: Int[np.ndarray, " n1"] | None = None
    ignored_before: Bool[np.ndarray, " n0"] | None = None
    ignored_after: Bool[np.ndarray, " n1"] | None = None
    views_before: SensorViews | None = None
    views_after: SensorViews | None = None
    unseen_before: Bool[np.ndarray, " n0"] | None = None
    unseen_after: Bool[np.ndarray, " n1"] | None = None

    @property
    def labelled(self) -> bool:
        """True if the truth of both clouds is known."""
        return self.truth_before is not None and self.truth_after is not None


def unchanged_pair(
    name: str,
    before: ArrayLike | PointCloud,
    after: ArrayLike | PointCloud,
    views_before: SensorViews | None = None,
    views_after: SensorViews | None = None,
) -> ScanPair:
    """Two scans of a place where nothing changed: every change reported there is a false alarm.

    Args:
        name: of the pair.
        before: coordinates [n0, 3] or a `PointCloud`.
        after: coordinates [n1, 3] or a `PointCloud`, in the same unit.
        views_before: where the sensor stood; None: not known.
        views_after: the same for `after`.
    """
    truth = Pair(before, after).map(lambda cloud: np.full(point_count(cloud), -1))
    return ScanPair(name, before, after, truth.before, truth.after, views_before=views_before, views_after=views_after)


def point_count(cloud: ArrayLike | PointCloud) -> int:
    """The number of rows of a cloud."""
    return len(cloud) if isinstance(cloud, PointCloud) else len(np.asarray(cloud))


def on_surfaces(pair: ScanPair, config: DetectionConfig) -> bool:
    """True if the clouds are samples of surfaces, where the verdict decides, not of volumes.

    Raises:
        InputError: clouds that cannot be compared; it names the pair.
    """
    checked, _ = _checked(pair, config)
    return not working_pair(checked.map(lambda cloud: cloud.points), config.voxel_size).volumetric


class JudgedPoints(NamedTuple):
    """Points of one cloud whose probability is judged.

    Attributes:
        points: in the frame of the fit.
        changed: the share of the observations at each that changed; 0 where that is not known.
        weight: the observations that each stands for; 0 is padding.
    """

    points: Float[Array, "m 3"]
    changed: Float[Array, " m"]
    weight: Float[Array, " m"]


class ReadyPair(eqx.Module):
    """A pair that is aligned and reduced, in the frame of its fit; NumPy leaves.

    Attributes:
        fitted: the points of both clouds that the mixture is fitted to.
        before: points of the before cloud that are judged; none of them is among `fitted` where there is no truth.
        after: the same for the after cloud.
        prior: derived from the data and the config, in the unit of the clouds.
        frame: from that unit into the fit's.
        max_components: that annihilation starts from.
        volumetric: whether the clouds fill volumes.
    """

    fitted: LabelledPoints
    before: JudgedPoints
    after: JudgedPoints
    prior: Prior
    frame: Standardisation
    max_components: int = eqx.field(static=True)
    volumetric: bool = eqx.field(static=True)


def ready_pair(pair: ScanPair, config: DetectionConfig, max_points: int, seed: int) -> ReadyPair:
    """Checks, aligns and reduces a pair as `detect_changes` does, and draws what is fitted and what is judged.

    Args:
        pair: the scans, with or without truth.
        config: everything that is not tuned.
        max_points: that are fitted, and that are judged of each cloud.
        seed: of the draw.

    Raises:
        InputError: clouds that cannot be compared, or truth that does not fit them; it names the pair.
    """
    checked, known = _checked(pair, config)
    placed = aligned(
        checked.map(lambda cloud: cloud.points),
        config.registration,
        config.voxel_size,
        one_system=in_one_system(Pair(pair.before, pair.after)),
        seed=config.seed,
    )
    check_overlap(checked, placed.registration)
    problem = joint_problem(placed.working, placed.registration, config)
    frame = Standardisation.of(problem.points.points)
    framed = LabelledPoints(frame.enter(problem.points.points), problem.points.after)
    generator = np.random.default_rng(seed)
    fitted, left = _fitted_and_left(len(framed.after), max_points, pair.labelled, generator)
    # Without truth the judges are points that the fit has not seen.
    rows = np.arange(len(framed.after)) if pair.labelled else left
    judged = _judged(framed, rows, each(_labels, placed.working.clouds, known), max_points, generator)
    chosen = LabelledPoints(
        WeightedPoints(framed.points.points[fitted], framed.points.mass[fitted]), framed.after[fitted]
    )
    return ReadyPair(
        fitted=chosen.padded(),
        before=judged.before,
        after=judged.after,
        prior=problem.prior,
        frame=frame,
        max_components=min(problem.max_components, max(1, len(fitted) // 20)),
        volumetric=problem.volumetric,
    )


class _Known(NamedTuple):
    """Truth of each point of a cloud, and the mask of those ignored; None where unknown."""

    truth: Int[np.ndarray, " n"] | None
    ignored: Bool[np.ndarray, " n"] | None


class _Labels(NamedTuple):
    """For each voxel the share of its points that changed, and how many of its points are judged."""

    changed: Float[np.ndarray, " m"]
    weight: Float[np.ndarray, " m"]


def _checked(pair: ScanPair, config: DetectionConfig) -> tuple[Pair[CheckedCloud], Pair[_Known]]:
    """The clouds, and what is known of the points that are used."""
    truth, ignored = Pair(pair.truth_before, pair.truth_after), Pair(pair.ignored_before, pair.ignored_after)
    try:
        checked = check_pair(Pair(pair.before, pair.after), config.crop)
        truth = each(functools.partial(_rows, kinds="iu"), Pair("truth_before", "truth_after"), truth, checked)
        ignored = each(functools.partial(_rows, kinds="b"), Pair("ignored_before", "ignored_after"), ignored, checked)
    except InputError as error:
        raise InputError(f"{pair.name}: {error}") from error
    return checked, each(_Known, truth, ignored)


def _rows(name: str, values: np.ndarray | None, cloud: CheckedCloud, kinds: str) -> np.ndarray | None:
    """Select the truth of the points that are used."""
    if values is None:
        return None
    values = np.asarray(values)
    if values.shape != (cloud.given,) or values.dtype.kind not in kinds:
        wanted = "whole numbers (-1, or the id of a change)" if "i" in kinds else "true or false"
        raise InputError(
            f"{name} must hold {wanted} for each of the {cloud.given} points, not {values.dtype} {list(values.shape)}"
        )
    return values[cloud.rows]


def _labels(cloud: WorkingCloud, known: _Known) -> _Labels:
    judged = np.ones(len(cloud.member)) if known.ignored is None else (~known.ignored).astype(float)
    weight = np.bincount(cloud.member, judged, len(cloud.points))
    changed = np.zeros(len(cloud.points))
    if known.truth is not None:
        changed = np.bincount(cloud.member, judged * (known.truth >= 0), len(cloud.points)) / np.maximum(weight, 1)
    return _Labels(changed, weight)


def _fitted_and_left(
    count: int, max_points: int, labelled: bool, generator: np.random.Generator
) -> tuple[Int[np.ndarray, " f"], Int[np.ndarray, " l"]]:
    """The rows of both clouds that are fitted, in random order, and those that are left."""
    order = generator.permutation(count)
    if not labelled and count <= max_points:
        # Held-out points are needed: half are fitted, half are judged.
        fitted, left = np.array_split(order, 2)
        return fitted, left
    return order[:max_points], order[max_points:]


def _judged(
    framed: LabelledPoints,
    rows: Int[np.ndarray, " l"],
    labels: Pair[_Labels],
    max_points: int,
    generator: np.random.Generator,
) -> Pair[JudgedPoints]:
    """The points of either cloud that are judged, drawn from these rows of both."""
    after = framed.after[rows] == 1
    first = len(labels.before.weight)

    def of_cloud(points: np.ndarray, own: np.ndarray, labels: _Labels) -> JudgedPoints:
        drawn, factor = _drawn(own, labels, max_points, generator)
        return _padded(JudgedPoints(points[drawn], labels.changed[drawn], labels.weight[drawn] * factor), max_points)

    return each(
        of_cloud, Pair(*np.split(framed.points.points, [first])), Pair(rows[~after], rows[after] - first), labels
    )


def _drawn(
    rows: np.ndarray, labels: _Labels, size: int, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Rows to judge, up to half of them changed, and by what factor each stands for more of its kind."""
    judged = rows[labels.weight[rows] > 0]
    if len(judged) <= size:
        return judged, np.ones(len(judged))
    changed = labels.changed[judged] >= 0.5
    kinds = [judged[changed], judged[~changed]]
    most = [min(len(kinds[0]), size // 2)]
    most.append(min(len(kinds[1]), size - most[0]))
    drawn = [generator.choice(kind, count, replace=False) for kind, count in zip(kinds, most, strict=True)]
    factors = [np.full(len(own), len(kind) / max(len(own), 1)) for own, kind in zip(drawn, kinds, strict=True)]
    return np.concatenate(drawn), np.concatenate(factors)


def _padded(judged: JudgedPoints, size: int) -> JudgedPoints:
    """One size for all pairs, so that they share a compiled program."""
    missing = size - len(judged.weight)
    return JudgedPoints(
        np.pad(judged.points, ((0, missing), (0, 0))),
        np.pad(judged.changed, (0, missing)),
        np.pad(judged.weight, (0, missing)),
    )
