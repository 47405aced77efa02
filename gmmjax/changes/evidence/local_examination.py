"""Candidates of scans whose resolution differs from place to place, each examined at its own resolution.

Facts are measured in spacings of the points, and learned from clouds of one spacing. A candidate is therefore
examined in clouds that have its resolution as far as it matters, and the coarse one elsewhere.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from gmmjax._memory import release_freed_memory
from gmmjax.changes.candidates import Candidates, probability_by_difference
from gmmjax.changes.differences import (
    DetectionLimits,
    Differences,
    LocalDifference,
    detection_limits,
    local_difference,
)
from gmmjax.changes.evidence.batches import Batch, batches_of
from gmmjax.changes.evidence.candidate import Candidate
from gmmjax.changes.evidence.examination import (
    EvidenceSettings,
    Examined,
    JudgedPiece,
    examined_cloud,
    judgement_of,
    measured_candidates,
    observed_places,
    warn_of_unlike,
)
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.changes.evidence.surroundings import Areas
from gmmjax.changes.evidence.verdict_file import Verdicts
from gmmjax.changes.explanation import Explanation
from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.changes.prepare.resolution import WorkingCloud
from gmmjax.clouds import voxel_grid
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each, parallel_map


@dataclasses.dataclass(frozen=True)
class LocalExaminationSettings:
    """In what clouds candidates are examined.

    Attributes:
        reach: distance from a candidate, in its own spacings, within which the clouds have its resolution: that within
            which facts look at points one by one. Smaller: they look at coarse ones.
        max_points: number of points of a candidate, at most; the spacing of a larger one is doubled until it has no
            more. A bound on the time: what is as large has as clear facts at half the resolution.
        min_share: fraction of the points of a larger voxel that are of a candidate, at least, for it to be of it. 0:
            candidates get thicker by what touches them.
        max_together: voxels of either scan, of the candidates' resolution, within reach of those that are examined
            together, at most; more candidates are examined in batches, by their place. A bound on memory: half a
            million take about a gigabyte. Few: the limits are those of few places; many: memory grows with the number
            of candidates.
    """

    reach: float = 65.0
    max_points: int = 20_000
    min_share: float = 0.5
    max_together: int = 500_000


class LocalScene(NamedTuple):
    """Two registered scans at their own resolution.

    Attributes:
        clouds: in voxels as small as the scans allow at each place.
        coarse: the same scans, the same resolution everywhere.
        surveys: the surfaces of `clouds`, with their views where they are known.
        differences: of `clouds` from each other.
        excess: gives the posterior of the joint mixture that points are of what only their cloud has; the second
            argument says whether that is the after cloud.
    """

    clouds: Pair[WorkingCloud]
    coarse: Pair[Float[np.ndarray, "_ 3"]]
    surveys: Pair[ScanVisibility]
    differences: Differences
    excess: Callable[[Float[np.ndarray, "n 3"], bool], RestartValues]


class AtResolution(NamedTuple):
    """The candidates of one resolution, or a batch of them.

    Attributes:
        pieces: that they were cut into; their rows are those of the clouds of this resolution.
        candidates: of both of these clouds.
        members: of each voxel of the scene the row in these clouds, -1 where it is out of reach.
    """

    pieces: Pair[list[Candidate]]
    candidates: Pair[Candidates]
    members: Pair[Int[np.ndarray, " _"]]


class _Cloud(NamedTuple):
    """One cloud, of one resolution within reach of some candidates.

    Attributes:
        points: first those within reach.
        inside: how many these are.
        member: of each voxel of the scene the row, -1 where it is out of reach.
    """

    points: Float[np.ndarray, "n 3"]
    inside: int
    member: Int[np.ndarray, " m"]


def examined_locally(
    candidates: Pair[Candidates],
    scene: LocalScene,
    verdicts: Verdicts,
    threshold: float = 0.5,
    evidence: EvidenceSettings = EvidenceSettings(),
    settings: LocalExaminationSettings = LocalExaminationSettings(),
) -> Pair[Examined]:
    """The candidates of both clouds that are changes, and what was not observed.

    Args:
        candidates: of the clouds of the scene.
        scene: what they are candidates of.
        verdicts: with and without the views of the other survey.
        threshold: probability from which on a candidate is a change.
        evidence: how facts are measured.
        settings: in what clouds.

    Warns:
        InputWarning: a candidate is unlike all that the verdict was learned from.
    """
    found = Pair(_Judged([], []), _Judged([], []))
    unlike = list[tuple[str, float]]()
    judged = functools.partial(_judge, found, candidates, verdicts)
    # Nothing keeps a batch when the next one is computed.
    for own in map(judged, candidates_by_resolution(candidates, scene, evidence, settings)):
        unlike += own
        release_freed_memory()
    warn_of_unlike(unlike, evidence)

    def of_cloud(fine: Candidates, own: _Judged, cloud: WorkingCloud) -> Examined:
        assert cloud.sizes is not None
        return examined_cloud(fine, own.pieces, tuple(own.explanations), cloud.sizes, threshold, evidence)

    return each(of_cloud, candidates, found, scene.clouds)


class _Judged(NamedTuple):
    pieces: list[JudgedPiece]
    explanations: list[Explanation]


def _judge(
    found: Pair[_Judged], candidates: Pair[Candidates], verdicts: Verdicts, batch: AtResolution
) -> list[tuple[str, float]]:
    """Adds the judged pieces of a batch, and says which facts of them are unlike all that the verdict learned from."""
    unlike = list[tuple[str, float]]()
    sides = zip(found, candidates, batch.pieces, batch.candidates, batch.members, strict=True)
    for own, fine, pieces, at_level, member in sides:
        judgement = judgement_of(at_level, pieces, verdicts)
        unlike += judgement.unlike
        for piece, explanation in zip(pieces, judgement.explanations, strict=True):
            own.pieces.append(JudgedPiece(_rows_of(piece, at_level, fine, member), len(own.pieces)))
            own.explanations.append(explanation)
    return unlike


def candidates_by_resolution(
    candidates: Pair[Candidates],
    scene: LocalScene,
    evidence: EvidenceSettings = EvidenceSettings(),
    settings: LocalExaminationSettings = LocalExaminationSettings(),
) -> Iterator[AtResolution]:
    """The candidates, cut into pieces, with all that facts are measured from, those of the smallest spacing first.

    Args:
        candidates: of the clouds of the scene.
        scene: what they are candidates of.
        evidence: how they are cut.
        settings: in what clouds they are examined.
    """
    resolutions = each(lambda own, cloud: _resolutions(own, cloud, settings), candidates, scene.clouds)
    areas = each(_areas, candidates, scene.clouds)
    for resolution in sorted({value for own in resolutions for value in own.values()}):
        chosen = resolutions.map(functools.partial(_numbers_at, resolution))
        shares = scene.clouds.map(functools.partial(_shares_at, resolution))
        for batch in batches_of(chosen, candidates, shares, settings.reach * resolution, settings.max_together):
            yield _at_resolution(resolution, batch, candidates, scene, areas, evidence, settings)


def _areas(own: Candidates, cloud: WorkingCloud) -> Areas:
    assert cloud.sizes is not None
    return Areas.of(own.labels, cloud.sizes)


def _shares_at(resolution: float, cloud: WorkingCloud) -> Float[np.ndarray, " n"]:
    """How much of a voxel of a larger size each voxel is."""
    assert cloud.sizes is not None
    # On a surface, half the size is four times as many.
    return np.minimum(cloud.sizes / resolution, 1.0) ** 2


def _numbers_at(resolution: float, of_candidates: dict[int, float]) -> list[int]:
    """The numbers of the candidates of one resolution."""
    return [number for number, own in of_candidates.items() if own == resolution]


def _resolutions(own: Candidates, cloud: WorkingCloud, settings: LocalExaminationSettings) -> dict[int, float]:
    """The spacing that each candidate is examined at, by its number."""
    assert cloud.sizes is not None
    found = {}
    for number in np.unique(own.labels[own.labels >= 0]).tolist():
        found[number] = examined_spacing(cloud.sizes[own.labels == number], settings)
    return found


def examined_spacing(sizes: Float[np.ndarray, " n"], settings: LocalExaminationSettings) -> float:
    """The spacing that a candidate is examined at: the median size of its voxels, or larger.

    Args:
        sizes: of its voxels.
        settings: how many points are examined.
    """
    # On a surface, twice the size is a quarter of the points.
    doubled = max(0.0, np.ceil(np.log2(len(sizes) / settings.max_points) / 2))
    return float(np.quantile(sizes, 0.5, method="lower") * 2.0**doubled)


def _at_resolution(
    spacing: float,
    batch: Batch,
    candidates: Pair[Candidates],
    scene: LocalScene,
    areas: Pair[Areas],
    evidence: EvidenceSettings,
    settings: LocalExaminationSettings,
) -> AtResolution:
    """A batch of candidates at one spacing."""
    cloud_within = functools.partial(_cloud, batch=batch, spacing=spacing)
    clouds = each(cloud_within, scene.clouds, scene.coarse, batch.rows)
    surfaces = parallel_map(lambda cloud: LocalSurface.of(cloud.points), clouds)
    differences = _differences(surfaces, clouds, scene.differences, spacing)
    surveys = each(lambda surface, survey: dataclasses.replace(survey, surface=surface), surfaces, scene.surveys)
    points = clouds.map(lambda cloud: cloud.points)
    observed = observed_places(points, surveys, differences)
    labels = each(lambda own, cloud, at: _labels(own, cloud, at, settings), candidates, scene.clouds, clouds)

    def of_cloud(
        points: np.ndarray, after: bool, local: LocalDifference, label: np.ndarray, seen: np.ndarray | None
    ) -> Candidates:
        looks_changed = probability_by_difference(local, differences.limits)
        return Candidates(points, local, scene.excess(points, after), looks_changed, label, seen)

    at_level = each(of_cloud, points, Pair(False, True), differences.local, labels, observed)
    pieces = measured_candidates(at_level, surveys, differences.limits, evidence, areas)
    own = each(lambda found, label, numbers: _pieces_of(found, label, numbers), pieces, labels, batch.numbers)
    return AtResolution(own, at_level, clouds.map(lambda cloud: cloud.member))


def _cloud(
    cloud: WorkingCloud,
    coarse: Float[np.ndarray, "c 3"],
    rows: Int[np.ndarray, " m"],
    batch: Batch,
    spacing: float,
) -> _Cloud:
    """The voxels within reach of a batch, those smaller than the spacing joined, and the coarse ones beyond."""
    assert cloud.sizes is not None
    beyond = coarse[~batch.within(coarse)]
    member = np.full(len(cloud.points), -1)
    small = cloud.sizes[rows] < spacing * (1 - 1e-9)
    joined, others = rows[small], rows[~small]
    grid = voxel_grid(cloud.points[joined], spacing)
    weight = np.bincount(grid.voxel_of_point, cloud.mass[joined], minlength=len(grid.mass))
    corner = batch.tree.mins
    moments = [
        np.bincount(grid.voxel_of_point, cloud.mass[joined] * (cloud.points[joined, axis] - corner[axis]), len(weight))
        for axis in range(3)
    ]
    means = corner + np.stack(moments, axis=1) / weight[:, None]
    member[joined] = grid.voxel_of_point
    member[others] = len(means) + np.arange(len(others))
    return _Cloud(np.concatenate([means, cloud.points[others], beyond]), len(means) + len(others), member)


def _differences(surfaces: Pair[LocalSurface], clouds: Pair[_Cloud], fine: Differences, spacing: float) -> Differences:
    """The differences at one spacing, with the registration error that the finest voxels show at each place."""
    settings = fine.limits.settings
    local = parallel_map(functools.partial(local_difference, settings=settings), surfaces, surfaces.swapped)
    error = each(lambda own, side: _error(own, side, fine.limits), clouds, fine.local)
    # Where one of the scans has nothing within reach, all points tell the limits.
    everywhere = not all(cloud.inside for cloud in clouds)
    counts = clouds.map(lambda own: len(own.points) if everywhere else own.inside)
    within = each(_first, local, counts)
    limits = detection_limits(within, spacing, settings)
    median = float(np.median(np.concatenate([*each(lambda own, count: own[:count], error, counts)])))
    limits = _with_registration_error(limits, median)
    return Differences(each(lambda side, own: side._replace(error=own), local, error), limits)


def _first(side: LocalDifference, count: int) -> LocalDifference:
    """The differences of the first points."""
    return jax.tree.map(lambda values: values[:count], side)


def _error(own: _Cloud, side: LocalDifference, limits: DetectionLimits) -> Float[np.ndarray, " n"]:
    """The registration error at each point; that of the pair out of reach."""
    errors = np.full(len(own.points), limits.registration_error)
    inside = own.member >= 0
    if side.error is not None:
        errors[own.member[inside]] = side.error[inside]
    return errors


def _with_registration_error(limits: DetectionLimits, error: float) -> DetectionLimits:
    settings = limits.settings
    offset = settings.offsets * error
    distance = max(settings.spacings * limits.spacing, settings.distances * limits.median_distance, offset)
    return limits._replace(registration_error=error, offset=offset, distance=distance)


def _labels(
    own: Candidates, cloud: WorkingCloud, at: _Cloud, settings: LocalExaminationSettings
) -> Int[np.ndarray, " n"]:
    """The candidate of each point: one that holds enough of its voxel."""
    inside = at.member >= 0
    differing = inside & (own.labels >= 0)
    mass = np.bincount(at.member[inside], cloud.mass[inside], minlength=len(at.points))
    of_candidates = np.bincount(at.member[differing], cloud.mass[differing], minlength=len(at.points))
    labels = np.full(len(at.points), -1)
    labels[at.member[differing]] = own.labels[differing]
    return np.where(of_candidates >= settings.min_share * mass, labels, -1)


def _pieces_of(pieces: list[Candidate], labels: Int[np.ndarray, " n"], numbers: list[int]) -> list[Candidate]:
    """The pieces of some candidates."""
    return [piece for piece in pieces if labels[piece.rows[0]] in numbers]


def _rows_of(
    piece: Candidate, at_level: Candidates, own: Candidates, member: Int[np.ndarray, " m"]
) -> Int[np.ndarray, " _"]:
    """The voxels of its candidate that a piece stands for."""
    of_piece = np.zeros(len(at_level.points), bool)
    of_piece[piece.rows] = True
    rows = np.flatnonzero((member >= 0) & (own.labels == at_level.labels[piece.rows[0]]))
    return rows[of_piece[member[rows]]]
