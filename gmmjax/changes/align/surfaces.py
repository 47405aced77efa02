"""Registration of scanned surfaces: many starts, robust point-to-plane ICP, a score from both sides."""

import dataclasses
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64

from gmmjax.changes.align.coarse import coarse_transforms, normal_space_sample
from gmmjax.changes.align.confidence import ConfidenceModel
from gmmjax.changes.align.mixing import Mixing
from gmmjax.changes.align.surface_fit import FitScoreSettings, SurfaceFit, random_sample, surface_fit
from gmmjax.changes.config import RegistrationMode
from gmmjax.changes.prepare.resolution import ResolutionSettings, working_pair
from gmmjax.changes.registration import Registration
from gmmjax.geometry import (
    PLANE_NEIGHBOURS,
    IcpSettings,
    LocalSurface,
    determined_part,
    evenly_chosen,
    point_to_plane_icp,
    transformed,
)
from gmmjax.pair import Pair, each_on_cores

# A finer convergence than the default one, and steps that are lengthened: transforms slide along walls.
ICP = IcpSettings(damping=1e-4, extrapolation=8.0)


@dataclasses.dataclass(frozen=True)
class SurfaceRegistrationSettings:
    """How scans are registered. Lengths in spacings are in multiples of the points' spacing.

    Attributes:
        voxels: of either cloud that starts are searched and refined on.
        sampled_points: of either cloud, at most, that these voxels are made of. Few: a voxel of a large site has some
            five, whose mean is so rough that the site, slid along itself, fits as well; many: time.
        start_points: of the after cloud that each start is refined with, evenly in the directions of their normals.
        start_icp: ICP for each start.
        finalists: distinct transforms that are refined further.
        finalist_points: of the after cloud that they are refined with, likewise.
        finalist_icp: ICP for each of them.
        points: of the after cloud that the best is refined with.
        fine_icp: ICP for the best, on the clouds' own resolution.
        score: which points transforms are judged by.
        first_reach: offset that has a quarter of the weight in the first step from the given frame, in spacings of the
            voxels; from the coarse transforms it is their accuracy.
        fine_reach: the same in the first step on the clouds' own resolution, in its spacings.
        last_reach: the same in the last steps, in standard deviations of the offsets.
        undetermined: a direction is not determined where the normals say at most this many times what their own noise
            would; such a motion is left out where the clouds fit as well without. 0: it never is.
        same_transform: transforms that differ by fewer spacings, over the points, are one.
        preference: for the given frame, in the score from 0 to 1: of transforms that fit equally well, such as along a
            plane, it is the one from there, and it is kept unless another is better by this. 0: any of them may be
            applied.
        more_consistent: a transform that was not found from the given frame must be more consistent than one from
            there by this. 1: it never is. -1: that with the highest score is taken, so that two surveys that share half
            of their extent are slid over each other.
        least_overlap: overlap of the transform from the given frame, at least, for that. 0: a corner that fits may be
            enough.
        needed: the transform is applied, too, when it lowers the residual to this fraction or raises the overlap by the
            rest, though the score hardly rises. 0: only where the score does.
        fine_doubt: `ConfidenceModel.doubt` up to which a transform that moves the points by no more than their spacing
            is applied; one that moves them farther is up to 1.
    """

    voxels: int = 8_000
    sampled_points: int = 200_000
    start_points: int = 250
    start_icp: IcpSettings = dataclasses.replace(ICP, steps=12)
    finalists: int = 2
    finalist_points: int = 600
    finalist_icp: IcpSettings = dataclasses.replace(ICP, steps=50)
    points: int = 3_000
    fine_icp: IcpSettings = dataclasses.replace(ICP, steps=20)
    score: FitScoreSettings = FitScoreSettings()
    first_reach: float = 6.0
    fine_reach: float = 3.0
    last_reach: float = 3.0
    undetermined: float = 2.0
    same_transform: float = 2.0
    preference: float = 0.01
    more_consistent: float = 0.02
    least_overlap: float = 0.2
    needed: float = 0.9
    fine_doubt: float = 2.0


class RoughRegistration(NamedTuple):
    """A transform of the after cloud that the fine registration starts from.

    Attributes:
        transform: rigid transform [4, 4]; the identity where the given frame is as good.
        from_given_frame: whether it was found from the frame that the clouds were given in.
        rival: ratio of the score of the next best, distinct transform to its own, 0 to 1.
    """

    transform: Float64[np.ndarray, "4 4"]
    from_given_frame: bool
    rival: float

    @property
    def moves(self) -> bool:
        """Whether it is not the identity."""
        return bool((self.transform != np.eye(4)).any())

    @classmethod
    def none(cls) -> "RoughRegistration":
        """The frame that the clouds were given in."""
        return cls(np.eye(4), from_given_frame=True, rival=0.0)


class SurfaceRegistration(NamedTuple):
    """The registration of two scans.

    Attributes:
        registration: the record.
        remark: what a user has to know of it, such as what an alignment would gain that was declined; None: nothing.
    """

    registration: Registration
    remark: str | None


class _Candidate(NamedTuple):
    transform: Float[np.ndarray, "4 4"]
    fit: SurfaceFit
    from_given_frame: bool


def rough_registration(
    points: Pair[Float64[np.ndarray, "_ 3"]], settings: SurfaceRegistrationSettings = SurfaceRegistrationSettings()
) -> RoughRegistration:
    """The best of many starts: ICP on few voxels, from the given frame and coarse transforms.

    Args:
        points: of both clouds. Clouds that fill volumes are left as they are.
        settings: how to register.
    """
    thinned = points.map(lambda cloud: cloud[evenly_chosen(len(cloud), settings.sampled_points)])
    pair = working_pair(thinned, settings=ResolutionSettings(voxels=settings.voxels))
    if pair.volumetric:
        return RoughRegistration.none()
    surfaces = each_on_cores(lambda cloud: LocalSurface.of(cloud.points, tree=cloud.tree), pair.clouds)
    finalists = _finalists(pair.spacing, surfaces, _refined_starts(pair.spacing, surfaces, settings), settings)
    given = surface_fit(surfaces, np.eye(4), pair.spacing, settings.score)
    # With the given frame itself: ICP from there may slide along a floor and a wall of which half is in common.
    best = _selected(finalists, _Candidate(np.eye(4), given, True), settings)
    own, apart = surfaces.after.points, settings.same_transform * pair.spacing
    others = (other for other in finalists if _distance(own, other.transform, best.transform) >= apart)
    rival = max((_ratio(other.fit, best.fit) for other in others), default=0.0)
    transform = best.transform if _better(best.fit, given, settings) else np.eye(4)
    return RoughRegistration(transform, best.from_given_frame, min(rival, 1.0))


def registered_surfaces(
    spacing: float,
    surfaces: Pair[LocalSurface],
    rough: RoughRegistration,
    mode: RegistrationMode,
    settings: SurfaceRegistrationSettings = SurfaceRegistrationSettings(),
    *,
    one_system: bool = False,
    only_fine: bool = False,
) -> SurfaceRegistration:
    """ICP at the clouds' own resolution, with "auto" only where it is needed, with "never" not at all.

    With "auto" a transform that moves the points by more than their spacing is a last resort: nearly all that agrees in
    the given frame must agree by it as well. Where both files state one reference system it is declined.

    Args:
        spacing: of the points, in the sparser cloud.
        surfaces: of both clouds; the after cloud's is roughly registered.
        rough: by which it is.
        mode: whether to register.
        settings: how to register.
        one_system: whether both files state the same coordinate reference system.
        only_fine: whether no other transform is applied.
    """
    to_given = np.linalg.inv(rough.transform)
    points = transformed(surfaces.after.points, to_given)
    given = _Candidate(np.eye(4), surface_fit(surfaces, to_given, spacing, settings.score), True)
    model = ConfidenceModel()
    if mode == "never":
        confidence = model.of_surfaces(given.fit, 0.0, True)
        return SurfaceRegistration(_record(given, given, points, confidence), _apart(given.fit))
    start = surface_fit(surfaces, np.eye(4), spacing, settings.score) if rough.moves else given.fit
    refined = _refined(spacing, surfaces, start, rough, settings)
    doubt = model.doubt(refined.fit, given.fit)
    better = rough.moves or _better(refined.fit, given.fit, settings)
    # A last resort is what moves the points by more than their spacing.
    moved = _distance(points, refined.transform, given.transform) / spacing
    far, near = moved > 1, moved <= settings.same_transform
    possible = doubt < 1 and not only_fine if far else doubt < settings.fine_doubt
    prior = model.stated if one_system else 1.0
    if mode == "always" or (better and possible):
        left = 0.0 if near else min(doubt, 1.0)
        confidence = model.of_surfaces(refined.fit, rough.rival, near, left, 1.0 if far else prior)
        record = _record(refined, given, points, confidence)
        moved_in_system = one_system and mode == "auto"
        return SurfaceRegistration(record, _moved(refined.transform, points) if moved_in_system else None)
    # A transform that is not applied has its own rival.
    rival = 0.0 if rough.moves else rough.rival
    against = 1 / max(doubt, np.finfo(np.float64).tiny) if far else 0.0
    confidence = model.of_surfaces(given.fit if far else refined.fit, rival, True, against, prior)
    contested = far and better
    if confidence < 1 and not contested:
        # Of a ball any rotation fits as well: the given frame is none the worse.
        confidence = max(confidence, Mixing.of(Pair(surfaces.before.points, points)).confidence())
    declined = _declined(refined, given, points, one_system) if contested and doubt < settings.fine_doubt else None
    return SurfaceRegistration(_record(given, given, points, confidence), declined or _apart(given.fit))


def _record(used: _Candidate, given: _Candidate, points: Float[np.ndarray, "n 3"], confidence: float) -> Registration:
    """The record of a candidate; `points` are those of the after cloud as it was given."""
    return Registration.measured(
        used.transform,
        points.mean(axis=0, keepdims=True),
        applied=used is not given,
        residual=used.fit.residual,
        residual_before=given.fit.residual,
        overlap=used.fit.overlap,
        confidence=confidence,
    )


def _declined(declined: _Candidate, given: _Candidate, points: Float[np.ndarray, "n 3"], one_system: bool) -> str:
    """What another alignment would have gained, and how to get it."""
    by = _record(declined, given, points, 1.0)
    why = "both files state one reference system" if one_system else "no other alignment fits nearly all that it fits"
    return (
        f"the after scan was kept in the frame that it was given in, because {why}. Moved by {by.displacement:.3g} and "
        f"{by.rotation_degrees:.2g} degrees {declined.fit.agreement:.0%} of the points that overlap would agree within "
        f"the noise, in place of {given.fit.agreement:.0%}, at a residual of {declined.fit.residual:.3g} in place of "
        f"{given.fit.residual:.3g}: registration='always' (--registration always) moves it"
    )


def _moved(transform: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "n 3"]) -> str:
    """How far a scan of the reference system that both files state was moved, and what that hides."""
    shift = (transformed(points, transform) - points).mean(axis=0)
    return (
        f"the after scan was moved by {shift[0]:.3g}, {shift[1]:.3g}, {shift[2]:.3g} in x, y and z, although both "
        "files state one reference system: what displaced everything, such as settlement, is in it and is no change. "
        "registration='never' (--registration never) keeps the frame that it was given in"
    )


def _apart(given: SurfaceFit) -> str | None:
    """That scans in the frames that they were given in disagree nearly everywhere; None where they do not."""
    if given.agreement >= 0.5 or not np.isfinite(given.residual):
        return None
    return (
        f"the scans lie apart nearly everywhere in the frame that they were given in: {given.agreement:.0%} of the "
        f"points that overlap agree within the noise, at a residual of {given.residual:.3g}. What changed "
        "nearly everywhere, such as by settlement or an error of a frame, raises the level of detection, and is "
        "reported as no change: look at the signed distances"
    )


def _selected(finalists: list[_Candidate], given: _Candidate, settings: SurfaceRegistrationSettings) -> _Candidate:
    """The finalist with the highest score, unless one from the given frame explains as well what both surveys cover.

    The highest score may be that of the greatest overlap: of two surveys of one half each, slid over each other.
    """
    best = finalists[0]
    near = [found for found in (*finalists, given) if found.from_given_frame]
    enough = [found for found in near if found.fit.overlap >= settings.least_overlap]
    own = max(enough, key=lambda found: found.fit.consistency, default=best)
    return best if best.fit.consistency > own.fit.consistency + settings.more_consistent else own


def _ratio(other: SurfaceFit, own: SurfaceFit) -> float:
    """Of the scores; of the consistencies where the other one has the higher score."""
    tiny = np.finfo(np.float64).tiny
    if other.score > own.score:
        return other.consistency / max(own.consistency, tiny)
    return other.score / max(own.score, tiny)


def _better(fit: SurfaceFit, given: SurfaceFit, settings: SurfaceRegistrationSettings) -> bool:
    """Whether a transform is needed, compared with the clouds as they were given.

    The residual is a median: it does not show how far off the ends of a long room are, which are few of its points. The
    score does. Where surveys overlap in part it may rise by sliding them over each other, the consistency does not.
    """
    rise = min(fit.score - given.score, fit.consistency - given.consistency)
    lower, wider = settings.needed * given.residual, given.overlap + (1 - settings.needed)
    return rise > settings.preference or fit.residual < lower or fit.overlap > wider


def _refined_starts(
    spacing: float, surfaces: Pair[LocalSurface], settings: SurfaceRegistrationSettings
) -> list[_Candidate]:
    """All starts after some steps of ICP on few points, the best first."""
    coarse = coarse_transforms(surfaces)
    means = surfaces.after.means(normal_space_sample(surfaces.after, settings.start_points))
    near = settings.first_reach * spacing
    starts = [(np.eye(4), near), *((transform, max(coarse.accuracy, near)) for transform in coarse.transforms)]
    few = dataclasses.replace(settings.score, points=2 * settings.start_points)
    candidates = []
    for number, (start, reach) in enumerate(starts):
        transform = point_to_plane_icp(means, surfaces.before, start, reach, spacing, settings.start_icp)
        candidates.append(_Candidate(transform, surface_fit(surfaces, transform, spacing, few), number == 0))
    return _best_first(candidates, settings)


def _finalists(
    spacing: float, surfaces: Pair[LocalSurface], starts: Iterable[_Candidate], settings: SurfaceRegistrationSettings
) -> list[_Candidate]:
    """The best distinct transforms after more steps of ICP, the best first, with that from the given frame."""
    means = surfaces.after.means(normal_space_sample(surfaces.after, settings.finalist_points))
    apart = settings.same_transform * spacing
    finalists: list[_Candidate] = []
    for start in starts:
        if len(finalists) >= settings.finalists and not start.from_given_frame:
            continue
        if any(_distance(means, start.transform, other.transform) < apart for other in finalists):
            continue
        reaches = settings.score.overlap_spacings * spacing, _last_reach(start.fit, spacing, settings)
        transform = point_to_plane_icp(means, surfaces.before, start.transform, *reaches, settings.finalist_icp)
        if any(_distance(means, transform, other.transform) < apart for other in finalists):
            continue
        fit = surface_fit(surfaces, transform, spacing, settings.score)
        finalists.append(_Candidate(transform, fit, start.from_given_frame))
        if len(finalists) >= settings.finalists and any(own.from_given_frame for own in finalists):
            break
    return _best_first(finalists, settings)


def _refined(
    spacing: float,
    surfaces: Pair[LocalSurface],
    start: SurfaceFit,
    rough: RoughRegistration,
    settings: SurfaceRegistrationSettings,
) -> _Candidate:
    """The rough registration refined on the most points, as a transform of the after cloud as it was given.

    `start` is how the surfaces fit by the rough registration. From the given frame it has no part that nothing
    determines, where the clouds fit as well without.
    """
    to_given = np.linalg.inv(rough.transform)
    means = surfaces.after.means(random_sample(len(surfaces.after), settings.points))
    reaches = settings.fine_reach * spacing, _last_reach(start, spacing, settings)
    left = point_to_plane_icp(means, surfaces.before, np.eye(4), *reaches, settings.fine_icp)
    fit = surface_fit(surfaces, left, spacing, settings.score)
    refined = _Candidate(left @ rough.transform, fit, rough.from_given_frame)
    if not rough.from_given_frame:
        return refined
    least = settings.undetermined * _normal_noise(surfaces.before)
    transform = determined_part(refined.transform, transformed(means, to_given), surfaces.before, reaches[1], least)
    without = surface_fit(surfaces, transform @ to_given, spacing, settings.score)
    return refined if without.score < fit.score - settings.preference / 2 else _Candidate(transform, without, True)


def _last_reach(fit: SurfaceFit, spacing: float, settings: SurfaceRegistrationSettings) -> float:
    """The offset that has a quarter of the weight in the last steps."""
    # Of equal clouds the residual is 0.
    least = np.sqrt(np.finfo(np.float64).eps) * spacing
    return float(settings.last_reach * np.clip(fit.residual, least, spacing / 2))


def _normal_noise(surface: LocalSurface) -> float:
    """Variance of the normals' angles about either axis, radians squared, by the scatter about the local planes."""
    variances = surface.variances
    return float(np.median(variances[:, 0] / np.maximum(PLANE_NEIGHBOURS * variances[:, 1], np.finfo(np.float64).tiny)))


def _best_first(candidates: Iterable[_Candidate], settings: SurfaceRegistrationSettings) -> list[_Candidate]:
    return sorted(candidates, key=lambda found: -found.fit.score - settings.preference * found.from_given_frame)


def _distance(points: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Root mean square distance between where two transforms bring the points."""
    return float(np.sqrt(((transformed(points, first) - transformed(points, second)) ** 2).sum(axis=1).mean()))
