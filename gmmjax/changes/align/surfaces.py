"""Registration of scanned surfaces: many starts, robust point-to-plane ICP, a score from both sides."""

import dataclasses
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64

from gmmjax.changes.align.coarse import coarse_transforms, normal_space_sample
from gmmjax.changes.align.confidence import ConfidenceModel
from gmmjax.changes.align.mixing import Mixing
from gmmjax.changes.align.surface_fit import OVERLAP_SPACINGS, SurfaceFit, random_sample, surface_fit
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
from gmmjax.pair import Pair, parallel_map

# A finer convergence than the default one, and steps that are lengthened: transforms slide along walls.
ICP = IcpSettings(damping=1e-4, extrapolation=8.0)
# Transforms that differ by fewer spacings, over the points, are one.
SAME_TRANSFORM = 2.0
# Preference for the given frame, in scores from 0 to 1: of transforms that fit equally well, such as along a plane, it
# is the one from there, and it is kept unless another is better by this.
PREFERENCE = 0.01
# Doubt up to which a transform that moves the points by no more than their spacing is applied; others: up to 1.
FINE_DOUBT = 2.0


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
        """True where it is not the identity."""
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


def rough_registration(points: Pair[Float64[np.ndarray, "_ 3"]]) -> RoughRegistration:
    """The best of many starts: ICP on few voxels, from the given frame and coarse transforms.

    Args:
        points: of both clouds. Clouds that fill volumes are left as they are.
    """
    # Of fewer points a voxel of a large site has so rough a mean that the site, slid along itself, fits as well.
    thinned = points.map(lambda cloud: cloud[evenly_chosen(len(cloud), 200_000)])
    pair = working_pair(thinned, settings=ResolutionSettings(voxels=8_000))
    if pair.volumetric:
        return RoughRegistration.none()
    surfaces = parallel_map(lambda cloud: LocalSurface.of(cloud.points, tree=cloud.tree), pair.clouds)
    finalists = _finalists(pair.spacing, surfaces, _refined_starts(pair.spacing, surfaces))
    given = surface_fit(surfaces, np.eye(4), pair.spacing)
    # With the given frame itself: ICP from there may slide along a floor and a wall of which half is in common.
    best = _selected(finalists, _Candidate(np.eye(4), given, True))
    own, apart = surfaces.after.points, SAME_TRANSFORM * pair.spacing
    others = (other for other in finalists if _distance(own, other.transform, best.transform) >= apart)
    rival = max((_ratio(other.fit, best.fit) for other in others), default=0.0)
    transform = best.transform if _better(best.fit, given) else np.eye(4)
    return RoughRegistration(transform, best.from_given_frame, min(rival, 1.0))


def registered_surfaces(
    spacing: float,
    surfaces: Pair[LocalSurface],
    rough: RoughRegistration,
    mode: RegistrationMode,
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
        one_system: whether both files state the same coordinate reference system.
        only_fine: whether no other transform is applied.
    """
    to_given = np.linalg.inv(rough.transform)
    points = transformed(surfaces.after.points, to_given)
    given = _Candidate(np.eye(4), surface_fit(surfaces, to_given, spacing), True)
    model = ConfidenceModel()
    if mode == "never":
        confidence = model.of_surfaces(given.fit, 0.0, True)
        return SurfaceRegistration(_record(given, given, points, confidence), _apart(given.fit))
    start = surface_fit(surfaces, np.eye(4), spacing) if rough.moves else given.fit
    refined = _refined(spacing, surfaces, start, rough)
    doubt = model.doubt(refined.fit, given.fit)
    better = rough.moves or _better(refined.fit, given.fit)
    # A last resort is what moves the points by more than their spacing.
    moved = _distance(points, refined.transform, given.transform) / spacing
    far, near = moved > 1, moved <= SAME_TRANSFORM
    possible = doubt < 1 and not only_fine if far else doubt < FINE_DOUBT
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
    declined = _declined(refined, given, points, one_system) if contested and doubt < FINE_DOUBT else None
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
    """The gain of an alignment that was declined, and how to get it, in words."""
    by = _record(declined, given, points, 1.0)
    why = "both files state one reference system" if one_system else "no other alignment fits nearly all that it fits"
    return (
        f"the after scan was kept in the frame that it was given in, because {why}. Moved by {by.displacement:.3g} and "
        f"{by.rotation_degrees:.2g} degrees {declined.fit.agreement:.0%} of the points that overlap would agree within "
        f"the noise, in place of {given.fit.agreement:.0%}, at a residual of {declined.fit.residual:.3g} in place of "
        f"{given.fit.residual:.3g}: registration='always' (--registration always) moves it"
    )


def _moved(transform: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "n 3"]) -> str:
    """The motion of a scan of the reference system that both files state, and what it hides, in words."""
    shift = (transformed(points, transform) - points).mean(axis=0)
    return (
        f"the after scan was moved by {shift[0]:.3g}, {shift[1]:.3g}, {shift[2]:.3g} in x, y and z, although both "
        "files state one reference system: what displaced everything, such as settlement, is in it and is no change. "
        "registration='never' (--registration never) keeps the frame that it was given in"
    )


def _apart(given: SurfaceFit) -> str | None:
    """A remark that scans disagree nearly everywhere in the frames that they were given in; None where they agree."""
    if given.agreement >= 0.5 or not np.isfinite(given.residual):
        return None
    return (
        f"the scans lie apart nearly everywhere in the frame that they were given in: {given.agreement:.0%} of the "
        f"points that overlap agree within the noise, at a residual of {given.residual:.3g}. What changed "
        "nearly everywhere, such as by settlement or an error of a frame, raises the level of detection, and is "
        "reported as no change: look at the signed distances"
    )


def _selected(finalists: list[_Candidate], given: _Candidate) -> _Candidate:
    """The finalist with the highest score, unless one from the given frame explains as well what both surveys cover.

    The highest score may be that of the greatest overlap: of two surveys of one half each, slid over each other.
    """
    best = finalists[0]
    near = [found for found in (*finalists, given) if found.from_given_frame]
    # With less overlap, a corner that fits would be enough.
    enough = [found for found in near if found.fit.overlap >= 0.2]
    own = max(enough, key=lambda found: found.fit.consistency, default=best)
    return best if best.fit.consistency > own.fit.consistency + 0.02 else own


def _ratio(other: SurfaceFit, own: SurfaceFit) -> float:
    """The ratio of the scores; of the consistencies where the other one has the higher score."""
    tiny = np.finfo(np.float64).tiny
    if other.score > own.score:
        return other.consistency / max(own.consistency, tiny)
    return other.score / max(own.score, tiny)


def _better(fit: SurfaceFit, given: SurfaceFit) -> bool:
    """True where a transform is needed, compared with the clouds as they were given.

    The residual is a median: it does not show how far off the ends of a long room are, which are few of its points. The
    score does. Where surveys overlap in part it may rise by sliding them over each other, the consistency does not.
    """
    rise = min(fit.score - given.score, fit.consistency - given.consistency)
    return rise > PREFERENCE or fit.residual < 0.9 * given.residual or fit.overlap > given.overlap + (1 - 0.9)


def _refined_starts(spacing: float, surfaces: Pair[LocalSurface]) -> list[_Candidate]:
    """All starts after some steps of ICP on few points, the best first."""
    coarse = coarse_transforms(surfaces)
    means = surfaces.after.means(normal_space_sample(surfaces.after, 250))
    near = 6 * spacing
    starts = [(np.eye(4), near), *((transform, max(coarse.accuracy, near)) for transform in coarse.transforms)]
    candidates, icp = [], dataclasses.replace(ICP, steps=12)
    for number, (start, reach) in enumerate(starts):
        transform = point_to_plane_icp(means, surfaces.before, start, reach, spacing, icp)
        candidates.append(_Candidate(transform, surface_fit(surfaces, transform, spacing, 500), number == 0))
    return _best_first(candidates)


def _finalists(
    spacing: float, surfaces: Pair[LocalSurface], starts: Iterable[_Candidate], count: int = 2
) -> list[_Candidate]:
    """The best distinct transforms after more steps of ICP, the best first, with that from the given frame."""
    means = surfaces.after.means(normal_space_sample(surfaces.after, 600))
    apart = SAME_TRANSFORM * spacing
    finalists, icp = list[_Candidate](), dataclasses.replace(ICP, steps=50)
    for start in starts:
        if len(finalists) >= count and not start.from_given_frame:
            continue
        if any(_distance(means, start.transform, other.transform) < apart for other in finalists):
            continue
        reaches = OVERLAP_SPACINGS * spacing, _last_reach(start.fit, spacing)
        transform = point_to_plane_icp(means, surfaces.before, start.transform, *reaches, icp)
        if any(_distance(means, transform, other.transform) < apart for other in finalists):
            continue
        fit = surface_fit(surfaces, transform, spacing)
        finalists.append(_Candidate(transform, fit, start.from_given_frame))
        if len(finalists) >= count and any(own.from_given_frame for own in finalists):
            break
    return _best_first(finalists)


def _refined(spacing: float, surfaces: Pair[LocalSurface], start: SurfaceFit, rough: RoughRegistration) -> _Candidate:
    """The rough registration refined on the most points, as a transform of the after cloud as it was given.

    `start` is how the surfaces fit by the rough registration. From the given frame it has no part that nothing
    determines, where the clouds fit as well without.
    """
    to_given = np.linalg.inv(rough.transform)
    means = surfaces.after.means(random_sample(len(surfaces.after), 3_000))
    reaches = 3 * spacing, _last_reach(start, spacing)
    left = point_to_plane_icp(means, surfaces.before, np.eye(4), *reaches, dataclasses.replace(ICP, steps=20))
    fit = surface_fit(surfaces, left, spacing)
    refined = _Candidate(left @ rough.transform, fit, rough.from_given_frame)
    if not rough.from_given_frame:
        return refined
    # Twice what the normals' own noise would say of a direction that nothing determines.
    least = 2 * _normal_noise(surfaces.before)
    transform = determined_part(refined.transform, transformed(means, to_given), surfaces.before, reaches[1], least)
    without = surface_fit(surfaces, transform @ to_given, spacing)
    return refined if without.score < fit.score - PREFERENCE / 2 else _Candidate(transform, without, True)


def _last_reach(fit: SurfaceFit, spacing: float) -> float:
    """The offset that has a quarter of the weight in the last steps: three standard deviations."""
    # Of equal clouds the residual is 0.
    least = np.sqrt(np.finfo(np.float64).eps) * spacing
    return float(3 * np.clip(fit.residual, least, spacing / 2))


def _normal_noise(surface: LocalSurface) -> float:
    """Variance of the normals' angles about either axis, radians squared, by the scatter about the local planes."""
    variances = surface.variances
    return float(np.median(variances[:, 0] / np.maximum(PLANE_NEIGHBOURS * variances[:, 1], np.finfo(np.float64).tiny)))


def _best_first(candidates: Iterable[_Candidate]) -> list[_Candidate]:
    return sorted(candidates, key=lambda found: -found.fit.score - PREFERENCE * found.from_given_frame)


def _distance(points: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Root mean square distance between where two transforms bring the points."""
    return float(np.sqrt(((transformed(points, first) - transformed(points, second)) ** 2).sum(axis=1).mean()))
