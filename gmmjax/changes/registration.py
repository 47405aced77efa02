"""Registration: the rigid transform that takes the after cloud into the frame of the before cloud."""

import dataclasses
from collections.abc import Iterable
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes.coarse_registration import coarse_transforms, normal_space_sample
from gmmjax.changes.component_consensus import consensus_displacement
from gmmjax.changes.config import DetectionConfig
from gmmjax.changes.local_difference import MEDIAN_TO_DEVIATION, SPACING_PER_SPREAD
from gmmjax.changes.registration_record import Registration
from gmmjax.changes.scales import WorkingPair
from gmmjax.changes.settling import determined_part, settled
from gmmjax.clouds.local_surface import MEAN_NEIGHBOURS, PLANE_NEIGHBOURS, LocalSurface, moved_points
from gmmjax.mixtures import FitSettings, GaussianMixture, best_fit, fit_restarts


@dataclasses.dataclass(frozen=True)
class RegistrationSettings:
    """How clouds are registered. Lengths in spacings are in multiples of the points' spacing.

    Attributes:
        target_points: of the before cloud that the starts are refined against.
        start_points: of the after cloud that each start is refined with, evenly in the directions of their normals.
        start_steps: of robust point-to-plane ICP for each start.
        finalists: distinct transforms that are refined further.
        finalist_points: of the after cloud that they are refined with, likewise.
        finalist_steps: of ICP for each of them, at most.
        points: of the after cloud that the best is refined with, and of both clouds that all are scored on.
        steps: of ICP for the best, at most.
        first_reach: offset that has a quarter of the weight in the first step from the given frame, in spacings; from
            the coarse transforms it is their accuracy.
        last_reach: the same in the last steps, in standard deviations of the offsets.
        damping: of ICP: a direction of motion that only this fraction of the points determines is damped by half. 0: a
            plane is moved along itself by noise, without end.
        extrapolation: of ICP: factor by which steps that shrink slowly are lengthened, at most. 1: none is.
        undetermined: a direction is not determined where the normals say at most this many times what their own noise
            would; such a motion is left out where the clouds fit as well without. 0: it never is.
        same_transform: transforms that differ by fewer spacings, over the points, are one.
        overlap_spacings: a point overlaps the other cloud when it is within this many spacings of it.
        preference: for the given frame, in the score from 0 to 1: of transforms that fit equally well, such as along a
            plane, it is the one from there. 0: any of them may be applied.
        needed: the transform is applied when it lowers the residual to this fraction or raises the overlap by the rest.
        significant: of volumetric clouds: a displacement is applied when it has this many standard errors.
        least_agreement: of volumetric clouds: and the components that agree on it have this fraction of the mass.
        components: of each mixture of volumetric clouds.
        component_points: that these are fitted to.
    """

    target_points: int = 6_000
    start_points: int = 300
    start_steps: int = 12
    finalists: int = 2
    finalist_points: int = 600
    finalist_steps: int = 50
    points: int = 3_000
    steps: int = 20
    first_reach: float = 6.0
    last_reach: float = 3.0
    damping: float = 1e-4
    extrapolation: float = 8.0
    undetermined: float = 2.0
    same_transform: float = 2.0
    overlap_spacings: float = 3.0
    preference: float = 0.01
    needed: float = 0.9
    significant: float = 4.0
    least_agreement: float = 0.4
    components: int = 25
    component_points: int = 6_000


class ConfidenceModel(NamedTuple):
    """The odds that a transform is wrong, as a sum of what speaks against it.

    Attributes:
        residual: odds at a residual of one noise, where another transform fits as well.
        residual_power: they grow with this power of the residual in noises,
        rival_power: and with this power of the ratio of the rival's score to its own.
        ambiguity_power: transforms away from the given frame: odds are this power of the ratio of the scores.
        overlap: overlap at which the odds are even.
        overlap_power: they fall with this power of the overlap.
    """

    residual: float = 0.01
    residual_power: float = 4.0
    rival_power: float = 12.0
    ambiguity_power: float = 60.0
    overlap: float = 0.17
    overlap_power: float = 4.0

    def confidence(self, fit: "SurfaceFit", rival: float, from_given_frame: bool) -> float:
        """The probability that a transform is right.

        Args:
            fit: how the clouds fit by it.
            rival: ratio of the score of the next best, distinct transform to its own.
            from_given_frame: whether it was found from the frame that the clouds were given in.
        """
        if not fit.overlap or not np.isfinite(fit.residual):
            return 0.0
        noises = max(fit.residual / max(fit.noise, np.finfo(np.float64).tiny), 1.0)
        odds = self.residual * min(noises, 1e3) ** self.residual_power * rival**self.rival_power
        odds += (self.overlap / fit.overlap) ** self.overlap_power
        odds += 0.0 if from_given_frame else rival**self.ambiguity_power
        return float(1 / (1 + odds))


class SurfaceFit(NamedTuple):
    """How two surfaces fit by a transform.

    Attributes:
        score: mean over the points of one, where the other surface passes through in the same direction, to 0; of the
            cloud where it is less.
        overlap: fraction of the points with a counterpart, likewise.
        residual: robust standard deviation of the offsets of these points, along the normal.
        noise: median of what the scatter about the local planes makes of it.
    """

    score: float
    overlap: float
    residual: float
    noise: float


class _Candidate(NamedTuple):
    transform: Float[np.ndarray, "4 4"]
    fit: SurfaceFit
    from_given_frame: bool


def register(
    pair: WorkingPair,
    before: LocalSurface,
    after: LocalSurface,
    config: DetectionConfig,
    settings: RegistrationSettings = RegistrationSettings(),
) -> Registration:
    """The registration of a pair; with "never" the identity, with "auto" where none is needed as well.

    Args:
        pair: both clouds.
        before: the surface of the before cloud.
        after: that of the after cloud.
        config: whether to register.
        settings: how.
    """
    if config.registration == "never":
        fit = surface_fit(before, after, np.eye(4), pair.spacing, settings)
        residual = 0.0 if pair.volumetric else fit.residual
        return _record(np.eye(4), after, applied=False, residual=residual, before=fit.residual, overlap=fit.overlap)
    if pair.volumetric:
        return _registered_volumes(pair, before, after, config, settings)
    return _registered_surfaces(pair, before, after, config, settings)


def surface_fit(
    before: LocalSurface,
    after: LocalSurface,
    transform: Float[np.ndarray, "4 4"],
    spacing: float,
    settings: RegistrationSettings = RegistrationSettings(),
) -> SurfaceFit:
    """How two surfaces fit by a transform of the after cloud, judged from both of them.

    Args:
        before: the surface of the before cloud.
        after: that of the after cloud.
        transform: rigid transform [4, 4].
        spacing: of the points, in the sparser cloud.
        settings: the number of points, and which of them overlap.
    """
    sides = (
        _one_sided_fit(after, before, transform, spacing, settings),
        _one_sided_fit(before, after, np.linalg.inv(transform), spacing, settings),
    )
    score, overlap = min(side.score for side in sides), min(side.overlap for side in sides)
    offsets = np.concatenate([side.offsets for side in sides])
    if not len(offsets):
        return SurfaceFit(score, overlap, float("inf"), float("inf"))
    noise = float(np.median(np.concatenate([side.noise for side in sides])))
    return SurfaceFit(score, overlap, MEDIAN_TO_DEVIATION * float(np.median(offsets)), noise)


class _OneSidedFit(NamedTuple):
    """`SurfaceFit` by the points of one cloud; offset and noise of those that overlap."""

    score: float
    overlap: float
    offsets: Float[np.ndarray, " m"]
    noise: Float[np.ndarray, " m"]


def _one_sided_fit(
    own: LocalSurface, other: LocalSurface, transform: np.ndarray, spacing: float, settings: RegistrationSettings
) -> _OneSidedFit:
    chosen = _sample(len(own), settings.points)
    means = moved_points(own.means(chosen), transform)
    there = other.nearest(means)
    normals = other.normals[there]
    offsets = np.abs(((means - other.centres[there]) * normals).sum(axis=1))
    distances = np.linalg.norm(means - other.points[there], axis=1)
    cosines = np.abs(((own.normals[chosen] @ transform[:3, :3].T) * normals).sum(axis=1))
    local_spacing = SPACING_PER_SPREAD * np.sqrt(other.variances[there, 1:].sum(axis=1))
    overlapping = distances < settings.overlap_spacings * np.maximum(spacing, local_spacing)
    # Geman and McClure's weight, at half a spacing a quarter; cosines' fourth power falls to a half at 33 degrees.
    scores = overlapping * cosines**4 / (1 + (2 * offsets / spacing) ** 2) ** 2
    noise = np.sqrt(own.variances[chosen, 0] / MEAN_NEIGHBOURS + other.variances[there, 0] / PLANE_NEIGHBOURS)
    return _OneSidedFit(float(scores.mean()), float(overlapping.mean()), offsets[overlapping], noise[overlapping])


def _registered_surfaces(
    pair: WorkingPair,
    before: LocalSurface,
    after: LocalSurface,
    config: DetectionConfig,
    settings: RegistrationSettings,
) -> Registration:
    """From the given frame and from coarse transforms, robust point-to-plane ICP; the best by its score."""
    given = surface_fit(before, after, np.eye(4), pair.spacing, settings)
    starts = _refined_starts(pair, before, after, settings)
    best, *others = _finalists(pair, before, after, starts, settings)
    best = _refined(best, pair, before, after, settings)
    rival = max((other.fit.score for other in others), default=0.0) / max(best.fit.score, np.finfo(np.float64).tiny)
    confidence = ConfidenceModel().confidence(best.fit, min(rival, 1.0), best.from_given_frame)
    better = best.fit.residual < settings.needed * given.residual
    applied = config.registration == "always" or better or best.fit.overlap > given.overlap + (1 - settings.needed)
    if not applied:
        best = _Candidate(np.eye(4), given, True)
    return _record(
        best.transform,
        after,
        applied=applied,
        residual=best.fit.residual,
        before=given.residual,
        overlap=best.fit.overlap,
        confidence=confidence,
    )


def _refined_starts(
    pair: WorkingPair, before: LocalSurface, after: LocalSurface, settings: RegistrationSettings
) -> list[_Candidate]:
    """All starts after some steps of ICP on few points, the best first."""
    coarse = coarse_transforms(before, after)
    few_before, few_after = (s.thinned(_sample(len(s), settings.target_points)) for s in (before, after))
    means = after.means(normal_space_sample(after, settings.start_points))
    near = settings.first_reach * pair.spacing
    starts = [(np.eye(4), near), *((transform, max(coarse.accuracy, near)) for transform in coarse.transforms)]
    few = dataclasses.replace(settings, points=2 * settings.start_points)
    candidates = []
    for number, (start, reach) in enumerate(starts):
        transform = settled(
            means,
            few_before,
            start,
            reach,
            pair.spacing,
            settings.start_steps,
            settings.damping,
            settings.extrapolation,
        )
        fit = surface_fit(few_before, few_after, transform, pair.spacing, few)
        candidates.append(_Candidate(transform, fit, number == 0))
    return _best_first(candidates, settings)


def _finalists(
    pair: WorkingPair,
    before: LocalSurface,
    after: LocalSurface,
    starts: Iterable[_Candidate],
    settings: RegistrationSettings,
) -> list[_Candidate]:
    """The best distinct transforms after more steps of ICP, the best first; at least one."""
    means = after.means(normal_space_sample(after, settings.finalist_points))
    apart = settings.same_transform * pair.spacing
    finalists: list[_Candidate] = []
    for start in starts:
        if any(_distance(means, start.transform, other.transform) < apart for other in finalists):
            continue
        first, last = settings.overlap_spacings * pair.spacing, _last_reach(start, pair, settings)
        transform = settled(
            means,
            before,
            start.transform,
            first,
            last,
            settings.finalist_steps,
            settings.damping,
            settings.extrapolation,
        )
        if any(_distance(means, transform, other.transform) < apart for other in finalists):
            continue
        fit = surface_fit(before, after, transform, pair.spacing, settings)
        finalists.append(_Candidate(transform, fit, start.from_given_frame))
        if len(finalists) == settings.finalists:
            break
    return _best_first(finalists, settings)


def _refined(
    candidate: _Candidate, pair: WorkingPair, before: LocalSurface, after: LocalSurface, settings: RegistrationSettings
) -> _Candidate:
    """The candidate after ICP on the most points; without motions that nothing determines where it fits as well."""
    means = after.means(_sample(len(after), settings.points))
    reach = _last_reach(candidate, pair, settings)
    transform = settled(
        means, before, candidate.transform, reach, reach, settings.steps, settings.damping, settings.extrapolation
    )
    fit = surface_fit(before, after, transform, pair.spacing, settings)
    refined = _Candidate(transform, fit, candidate.from_given_frame)
    if not candidate.from_given_frame:
        return refined
    transform = determined_part(transform, means, before, reach, settings.undetermined * _normal_noise(before))
    without = surface_fit(before, after, transform, pair.spacing, settings)
    return refined if without.score < fit.score - settings.preference / 2 else _Candidate(transform, without, True)


def _last_reach(candidate: _Candidate, pair: WorkingPair, settings: RegistrationSettings) -> float:
    """The offset that has a quarter of the weight in the last steps."""
    return settings.last_reach * min(candidate.fit.residual, pair.spacing / 2)


def _normal_noise(surface: LocalSurface) -> float:
    """Variance of the normals' angles about either axis, radians squared, by the scatter about the local planes."""
    variances = surface.variances
    return float(np.median(variances[:, 0] / np.maximum(PLANE_NEIGHBOURS * variances[:, 1], np.finfo(np.float64).tiny)))


def _best_first(candidates: Iterable[_Candidate], settings: RegistrationSettings) -> list[_Candidate]:
    return sorted(candidates, key=lambda found: -found.fit.score - settings.preference * found.from_given_frame)


def _distance(points: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Root mean square distance between where two transforms bring the points."""
    return float(np.sqrt(((moved_points(points, first) - moved_points(points, second)) ** 2).sum(axis=1).mean()))


def _registered_volumes(
    pair: WorkingPair,
    before: LocalSurface,
    after: LocalSurface,
    config: DetectionConfig,
    settings: RegistrationSettings,
) -> Registration:
    """The displacement on which most components agree, where it exceeds its standard error."""
    consensus = consensus_displacement(*_mixtures(pair, config, settings))
    if consensus.share < settings.least_agreement:
        overlap = surface_fit(before, after, np.eye(4), pair.spacing, settings).overlap
        return _record(np.eye(4), after, applied=False, residual=0.0, before=0.0, overlap=overlap)
    length = float(np.linalg.norm(consensus.displacement))
    errors = float(np.linalg.norm(consensus.displacement / consensus.standard_error))
    applied = config.registration == "always" or errors > settings.significant
    transform = np.eye(4)
    if applied:
        transform[:3, 3] = consensus.displacement
    overlap = max(consensus.share, surface_fit(before, after, transform, pair.spacing, settings).overlap)
    error = float(np.sqrt((consensus.standard_error**2).mean())) if applied else 0.0
    return _record(transform, after, applied=applied, residual=error, before=length, overlap=overlap)


def _record(
    transform: np.ndarray,
    after: LocalSurface,
    *,
    applied: bool,
    residual: float,
    before: float,
    overlap: float,
    confidence: float = 1.0,
) -> Registration:
    """The record; a residual without any overlap is not known."""
    centre = after.points.mean(axis=0, keepdims=True)
    displacement = float(np.linalg.norm(moved_points(centre, transform) - centre))
    return Registration(
        transform=transform,
        applied=applied,
        displacement=displacement,
        residual=residual if np.isfinite(residual) else None,
        residual_before=before if np.isfinite(before) else None,
        overlap=overlap,
        confidence=confidence,
    )


def _mixtures(
    pair: WorkingPair, config: DetectionConfig, settings: RegistrationSettings
) -> tuple[GaussianMixture, GaussianMixture, float, float]:
    """A mixture of each cloud, with their numbers of points."""
    mixtures = []
    for cloud, key in zip((pair.before, pair.after), jax.random.split(jax.random.key(config.seed), 2), strict=True):
        points = cloud.points[_sample(len(cloud.points), settings.component_points)]
        fits = fit_restarts(
            points,
            key=key,
            max_components=max(1, min(settings.components, len(points) // 10)),
            restarts=2,
            settings=FitSettings(patience=0.05),
        )
        mixtures.append(best_fit(fits).mixture)
    return mixtures[0], mixtures[1], float(len(pair.before.points)), float(len(pair.after.points))


def _sample(count: int, size: int) -> Int[np.ndarray, " m"]:
    """The indices of at most this number of points, at random, the same each time."""
    return np.arange(count) if count <= size else np.random.default_rng(0).choice(count, size, replace=False)
