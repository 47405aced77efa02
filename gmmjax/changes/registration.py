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
from gmmjax.changes.scales import WorkingPair, working_pair
from gmmjax.changes.settling import determined_part, settled
from gmmjax.clouds.local_surface import (
    MEAN_NEIGHBOURS,
    PLANE_NEIGHBOURS,
    LocalSurface,
    evenly_chosen,
    moved_points,
    rotated,
)
from gmmjax.mixtures import FitSettings, GaussianMixture, best_fit, fit_restarts


@dataclasses.dataclass(frozen=True)
class RegistrationSettings:
    """How clouds are registered. Lengths in spacings are in multiples of the points' spacing.

    Attributes:
        voxels: of either cloud that starts are searched and refined on.
        sampled_points: of either cloud, at most, that these voxels are made of.
        start_points: of the after cloud that each start is refined with, evenly in the directions of their normals.
        start_steps: of robust point-to-plane ICP for each start.
        finalists: distinct transforms that are refined further.
        finalist_points: of the after cloud that they are refined with, likewise.
        finalist_steps: of ICP for each of them, at most.
        points: of the after cloud that the best is refined with, and of both clouds that all are scored on.
        steps: of ICP for the best, at most.
        first_reach: offset that has a quarter of the weight in the first step from the given frame, in spacings of the
            voxels; from the coarse transforms it is their accuracy.
        fine_reach: the same in the first step on the clouds' own resolution, in its spacings.
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
        least_components: of volumetric clouds: with fewer in either mixture it says nothing whether they agree.
        least_points: of volumetric clouds: with fewer in either, their components are too uncertain for that, too.
        components: of each mixture of volumetric clouds.
        component_points: that these are fitted to.
    """

    voxels: int = 8_000
    sampled_points: int = 40_000
    start_points: int = 250
    start_steps: int = 12
    finalists: int = 2
    finalist_points: int = 600
    finalist_steps: int = 50
    points: int = 3_000
    steps: int = 20
    first_reach: float = 6.0
    fine_reach: float = 3.0
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
    least_components: int = 3
    least_points: int = 1_000
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
        agreement: of volumetric clouds: share of the mass whose components agree at which the odds are even.
        agreement_power: they fall with this power of that share.
        negligible: odds below which a registration is not in doubt, so that it leaves the probabilities as they are.
    """

    residual: float = 0.01
    residual_power: float = 4.0
    rival_power: float = 12.0
    ambiguity_power: float = 60.0
    overlap: float = 0.17
    overlap_power: float = 4.0
    agreement: float = 0.3
    agreement_power: float = 8.0
    negligible: float = 0.01

    def confidence_of_agreement(self, share: float) -> float:
        """The probability that a displacement is right on which components with this share of the mass agree."""
        return 0.0 if share <= 0 else self._of_odds((self.agreement / share) ** self.agreement_power)

    def _of_odds(self, odds: float) -> float:
        return 1.0 if odds < self.negligible else float(1 / (1 + odds))

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
        return self._of_odds(odds)


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


class RegisteredPair(NamedTuple):
    """Two clouds in the frame of the before cloud.

    Attributes:
        pair: both clouds at the resolution that they are compared at.
        before: the surface of the before cloud.
        after: that of the after cloud, registered.
        registration: by which it was.
    """

    pair: WorkingPair
    before: LocalSurface
    after: LocalSurface
    registration: Registration


def registered_pair(
    before: Float[np.ndarray, "n0 3"],
    after: Float[np.ndarray, "n1 3"],
    config: DetectionConfig,
    settings: RegistrationSettings = RegistrationSettings(),
) -> RegisteredPair:
    """Registers two clouds, and reduces them to the resolution that they are compared at.

    The voxels of the after cloud are those of the frame that it is compared in: what is found does not depend on the
    frame that it was given in.

    Args:
        before: all points of the before cloud that are compared, in any unit.
        after: those of the after cloud.
        config: whether to register, and the voxels' edge.
        settings: how to register.
    """
    rough = _given_frame() if config.registration == "never" else rough_registration(before, after, config, settings)
    pair = working_pair(before, moved_points(after, rough.transform) if rough.moves else after, config)
    surfaces = LocalSurface.of(pair.before.points), LocalSurface.of(pair.after.points)
    if pair.volumetric:
        registration = _registered_volumes(pair, *surfaces, config, settings)
    else:
        registration = _registered_surfaces(pair, *surfaces, rough, config, settings)
    if not registration.applied:
        return RegisteredPair(pair, *surfaces, registration)
    if pair.voxel_size is not None:
        pair = pair.with_after_of(registration.apply(after))
        surfaces = surfaces[0], LocalSurface.of(pair.after.points)
    else:
        # What is left to be moved after the rough registration.
        left = registration.transform @ np.linalg.inv(rough.transform)
        surfaces = surfaces[0], surfaces[1].moved(left)
        pair = pair.with_after(surfaces[1].points)
    return RegisteredPair(pair, *surfaces, registration)


class RoughRegistration(NamedTuple):
    """A transform of the after cloud that the fine registration starts from.

    Attributes:
        transform: rigid transform [4, 4]; the identity where the given frame is as good.
        from_given_frame: whether it was found from the frame that the clouds were given in.
        rival: ratio of the score of the next best, distinct transform to its own, 0 to 1.
    """

    transform: Float[np.ndarray, "4 4"]
    from_given_frame: bool
    rival: float

    @property
    def moves(self) -> bool:
        """Whether it is not the identity."""
        return bool((self.transform != np.eye(4)).any())


def _given_frame() -> RoughRegistration:
    return RoughRegistration(np.eye(4), from_given_frame=True, rival=0.0)


def rough_registration(
    before: Float[np.ndarray, "n0 3"],
    after: Float[np.ndarray, "n1 3"],
    config: DetectionConfig = DetectionConfig(),
    settings: RegistrationSettings = RegistrationSettings(),
) -> RoughRegistration:
    """The best of many starts: robust point-to-plane ICP on few voxels, from the given frame and coarse transforms.

    Args:
        before: the before cloud.
        after: the after cloud. Clouds that fill volumes are left as they are.
        config: all settings.
        settings: how to register.
    """
    thinned = [points[evenly_chosen(len(points), settings.sampled_points)] for points in (before, after)]
    pair = working_pair(thinned[0], thinned[1], dataclasses.replace(config, voxel_size=None), settings.voxels)
    if pair.volumetric:
        return _given_frame()
    surfaces = LocalSurface.of(pair.before.points), LocalSurface.of(pair.after.points)
    best, *others = _finalists(pair, *surfaces, _refined_starts(pair, *surfaces, settings), settings)
    rival = max((other.fit.score for other in others), default=0.0) / max(best.fit.score, np.finfo(np.float64).tiny)
    given = surface_fit(*surfaces, np.eye(4), pair.spacing, settings)
    transform = best.transform if _better(best.fit, given, settings) else np.eye(4)
    return RoughRegistration(transform, best.from_given_frame, min(rival, 1.0))


def _better(fit: "SurfaceFit", given: "SurfaceFit", settings: RegistrationSettings) -> bool:
    """Whether a transform is needed, compared with the clouds as they were given."""
    return fit.residual < settings.needed * given.residual or fit.overlap > given.overlap + (1 - settings.needed)


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
    cosines = np.abs((rotated(own.normals[chosen], transform) * normals).sum(axis=1))
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
    rough: RoughRegistration,
    config: DetectionConfig,
    settings: RegistrationSettings,
) -> Registration:
    """Robust point-to-plane ICP at the clouds' own resolution; `after` is roughly registered.

    With "auto" only where it is needed, with "never" not at all.
    """
    to_given = np.linalg.inv(rough.transform)
    given = surface_fit(before, after, to_given, pair.spacing, settings)
    transform, fit, applied = np.eye(4), given, False
    confidence = ConfidenceModel().confidence(given, 0.0, True)
    if config.registration != "never":
        refined = _refined(pair, before, after, rough, settings)
        confidence = ConfidenceModel().confidence(refined.fit, rough.rival, rough.from_given_frame)
        applied = config.registration == "always" or rough.moves or _better(refined.fit, given, settings)
        if applied:
            transform, fit = refined.transform, refined.fit
    # The centre of the after cloud as it was given.
    centre = moved_points(after.points.mean(axis=0, keepdims=True), to_given)
    return _record(
        transform,
        centre,
        applied=applied,
        residual=fit.residual,
        before=given.residual,
        overlap=fit.overlap,
        confidence=confidence,
    )


def _refined_starts(
    pair: WorkingPair, before: LocalSurface, after: LocalSurface, settings: RegistrationSettings
) -> list[_Candidate]:
    """All starts after some steps of ICP on few points, the best first."""
    coarse = coarse_transforms(before, after)
    means = after.means(normal_space_sample(after, settings.start_points))
    near = settings.first_reach * pair.spacing
    starts = [(np.eye(4), near), *((transform, max(coarse.accuracy, near)) for transform in coarse.transforms)]
    few = dataclasses.replace(settings, points=2 * settings.start_points)
    candidates = []
    for number, (start, reach) in enumerate(starts):
        transform = settled(
            means,
            before,
            start,
            reach,
            pair.spacing,
            settings.start_steps,
            settings.damping,
            settings.extrapolation,
        )
        fit = surface_fit(before, after, transform, pair.spacing, few)
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
        first, last = settings.overlap_spacings * pair.spacing, _last_reach(start.fit, pair, settings)
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
    pair: WorkingPair,
    before: LocalSurface,
    after: LocalSurface,
    rough: RoughRegistration,
    settings: RegistrationSettings,
) -> _Candidate:
    """The rough registration refined on the most points, as a transform of the after cloud as it was given.

    From the given frame it has no part that nothing determines, where the clouds fit as well without.
    """
    to_given = np.linalg.inv(rough.transform)
    means = after.means(_sample(len(after), settings.points))
    start = surface_fit(before, after, np.eye(4), pair.spacing, settings)
    reaches = settings.fine_reach * pair.spacing, _last_reach(start, pair, settings)
    left = settled(means, before, np.eye(4), *reaches, settings.steps, settings.damping, settings.extrapolation)
    fit = surface_fit(before, after, left, pair.spacing, settings)
    refined = _Candidate(left @ rough.transform, fit, rough.from_given_frame)
    if not rough.from_given_frame:
        return refined
    least = settings.undetermined * _normal_noise(before)
    transform = determined_part(refined.transform, moved_points(means, to_given), before, reaches[1], least)
    without = surface_fit(before, after, transform @ to_given, pair.spacing, settings)
    return refined if without.score < fit.score - settings.preference / 2 else _Candidate(transform, without, True)


def _last_reach(fit: SurfaceFit, pair: WorkingPair, settings: RegistrationSettings) -> float:
    """The offset that has a quarter of the weight in the last steps."""
    # Of equal clouds the residual is 0.
    least = np.sqrt(np.finfo(np.float64).eps) * pair.spacing
    return float(settings.last_reach * np.clip(fit.residual, least, pair.spacing / 2))


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
    """The displacement on which most components agree, where it exceeds its standard error; none with "never"."""
    centre = after.points.mean(axis=0, keepdims=True)
    if config.registration == "never":
        fit = surface_fit(before, after, np.eye(4), pair.spacing, settings)
        return _record(np.eye(4), centre, applied=False, residual=0.0, before=fit.residual, overlap=fit.overlap)
    mixtures = _mixtures(pair, config, settings)
    consensus = consensus_displacement(*mixtures)
    judged = min(mixtures[0].live.sum(), mixtures[1].live.sum()) >= settings.least_components
    judged &= min(len(before), len(after)) >= settings.least_points
    confidence = ConfidenceModel().confidence_of_agreement(consensus.share) if judged else 1.0
    length = float(np.linalg.norm(consensus.displacement))
    errors = float(np.linalg.norm(consensus.displacement / consensus.standard_error))
    agreed = consensus.share >= settings.least_agreement
    applied = agreed and (config.registration == "always" or errors > settings.significant)
    transform = np.eye(4)
    if applied:
        transform[:3, 3] = consensus.displacement
    error = float(np.sqrt((consensus.standard_error**2).mean())) if applied else 0.0
    return _record(
        transform,
        centre,
        applied=applied,
        residual=error,
        before=length,
        overlap=consensus.share,
        confidence=confidence,
    )


def _record(
    transform: np.ndarray,
    centre: Float[np.ndarray, "1 3"],
    *,
    applied: bool,
    residual: float,
    before: float,
    overlap: float,
    confidence: float = 1.0,
) -> Registration:
    """The record; a residual without any overlap is not known."""
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
