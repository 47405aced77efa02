"""The rigid transform that lays one scanned object best onto another, and what is known of how well it fits."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.overlap import Overlap, OverlapSettings, overlap
from gmmjax.changes.objects.rigid_match import RigidMatchSettings, refined_match, rigid_matches, rigid_matches_near
from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.changes.objects.top import Top, top_of
from gmmjax.changes.objects.upright import UprightSettings, stays_upright, upright_transforms
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class MatchSettings:
    """How the transform between two objects is found.

    All values are empirical: they come from development on the scenes of docs/results.md. Heights are in
    standard deviations of the offset between local means of one surface.

    Attributes:
        transforms: number of candidate transforms where the support planes are not known.
        upright_transforms: number of those that keep an object upright: more, since partly observed sides fit each
            other at many headings.
        coarse_sample: number of points of either object that every candidate is compared by.
        most_contradicted: fraction of the points above which the best candidate is not refined. 1: it always is.
        refined: number of candidates, the best, that are refined.
        sample: number of points of either object that a refined transform is compared by.
        contradiction: contradicted points cost this multiple of what covered points gain in the comparison of
            transforms. 0: contradictions do not count.
        rotation_penalty: fraction of the points that a rotation by 180 degrees costs there: of the transforms that fit
            a symmetric object the one with the smallest rotation is taken. 0: any of them.
        same_height: largest distance of the support planes after the transform. Infinite: objects may sink or float.
        other_height: objects whose tops differ in height by more are not compared: saves time. Infinite: all are.
        overlap: when a point lies on a surface.
        rigid: how transforms are searched.
        upright: what objects stand on, and which transforms keep them upright.
    """

    transforms: int = 7
    upright_transforms: int = 10
    coarse_sample: int = 200
    most_contradicted: float = 0.3
    refined: int = 2
    sample: int = 800
    contradiction: float = 4.0
    rotation_penalty: float = 0.05
    same_height: float = 3.0
    other_height: float = 12.0
    overlap: OverlapSettings = OverlapSettings()
    rigid: RigidMatchSettings = RigidMatchSettings()
    upright: UprightSettings = UprightSettings()


class Match(NamedTuple):
    """How well one object can be laid onto another.

    Attributes:
        transform: rigid transform [4, 4] from the first to the second.
        there: how the first one fits the second.
        back: how the second one fits the first.
        upright: whether it brings the support plane of the first one onto that of the second.
        tops: of both, above their support planes; None: too little of one was observed, or its support plane was not.
        settings: how transforms are compared.
    """

    transform: Float[np.ndarray, "4 4"]
    there: Overlap
    back: Overlap
    upright: bool = False
    tops: Pair[Top] | None = None
    settings: MatchSettings = MatchSettings()

    @property
    def merit(self) -> float:
        """What transforms are ranked by; of equal ones, as of a symmetric object, the smallest rotation is first."""
        half_turns = Rotation.from_matrix(self.transform[:3, :3]).magnitude() / np.pi
        contradiction = self.settings.contradiction
        fits = sum(side.covered - contradiction * side.contradicted for side in (self.there, self.back))
        return float(fits - self.settings.rotation_penalty * half_turns)


class _Candidates(NamedTuple):
    """Candidate transforms, whether they keep the object upright, and the tops of both objects."""

    transforms: Sequence[Float[np.ndarray, "4 4"]]
    upright: bool
    tops: Pair[Top] | None


def best_match(
    parts: Pair[LocalSurface],
    surfaces: Pair[LocalSurface],
    noise: float,
    stood_on: Pair[SupportPlane | None] = Pair(None, None),
    settings: MatchSettings = MatchSettings(),
) -> Match | None:
    """The rigid transform that lays a disappeared object best onto an appeared one.

    Where both support planes are known, only transforms that keep the object upright are candidates: objects are put
    down on the side that they stood on, and two different boxes often fit each other when one may be tilted or sunk
    into the floor.

    Args:
        parts: what disappeared from the before cloud, and what appeared in the after cloud.
        surfaces: of both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.
        stood_on: the support plane of either, where it is known.
        settings: how the transform is found.

    Returns:
        The match; None where no transform keeps the object upright.
    """
    candidates = _candidates(parts, noise, stood_on, settings)
    if not candidates.transforms:
        return None
    matches = [
        _match(parts, transform, surfaces, noise, settings.coarse_sample, settings)
        for transform in candidates.transforms
    ]
    matches.sort(key=lambda match: match.merit, reverse=True)
    if min(matches[0].there.contradicted, matches[0].back.contradicted) > settings.most_contradicted:
        return matches[0]._replace(upright=candidates.upright, tops=candidates.tops)
    best = max(
        (_refined(parts, match, surfaces, noise, settings) for match in matches[: settings.refined]),
        key=lambda match: match.merit,
    )
    return best._replace(upright=candidates.upright, tops=candidates.tops)


def _candidates(
    parts: Pair[LocalSurface], noise: float, stood_on: Pair[SupportPlane | None], settings: MatchSettings
) -> _Candidates:
    if stood_on.before is None or stood_on.after is None:
        return _Candidates(
            rigid_matches(parts.before, parts.after, noise, settings.transforms, settings.rigid), False, None
        )
    return _upright_candidates(parts, noise, Pair(stood_on.before, stood_on.after), settings)


def _upright_candidates(
    parts: Pair[LocalSurface], noise: float, planes: Pair[SupportPlane], settings: MatchSettings
) -> _Candidates:
    """The candidates that keep the object upright; none where the tops differ in height."""
    upright = settings.upright
    first, second = each(lambda part, plane: top_of(part, plane, noise, upright.top), parts, planes)
    tops = None if first is None or second is None else Pair(first, second)
    if tops is not None and abs(tops.before.height - tops.after.height) > settings.other_height * noise:
        return _Candidates([], True, tops)
    starts = upright_transforms(parts, planes, upright)
    found = rigid_matches_near(parts.before, parts.after, starts, noise, settings.upright_transforms, settings.rigid)
    middle, tolerance = parts.after.points.mean(axis=0), settings.same_height * noise
    kept = [transform for transform in found if stays_upright(transform, planes, middle, tolerance, upright)]
    return _Candidates(kept, True, tops)


def _refined(
    parts: Pair[LocalSurface], match: Match, surfaces: Pair[LocalSurface], noise: float, settings: MatchSettings
) -> Match:
    transform = refined_match(parts.before, parts.after, match.transform, noise, settings.rigid)
    return _match(parts, transform, surfaces, noise, settings.sample, settings)


def _match(
    parts: Pair[LocalSurface],
    transform: Float[np.ndarray, "4 4"],
    surfaces: Pair[LocalSurface],
    noise: float,
    sample: int,
    settings: MatchSettings,
) -> Match:
    return match_of(parts, transform, surfaces, noise, dataclasses.replace(settings, sample=sample))


def match_of(
    parts: Pair[LocalSurface],
    transform: Float[np.ndarray, "4 4"],
    surfaces: Pair[LocalSurface],
    noise: float,
    settings: MatchSettings = MatchSettings(),
) -> Match:
    """How well a known transform lays the one object onto the other.

    Args:
        parts: both objects.
        transform: rigid transform [4, 4] from the first to the second.
        surfaces: of both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.
        settings: how many points are compared, and when they lie on a surface.
    """
    ways = Pair(transform, np.linalg.inv(transform))

    def fits(own: LocalSurface, way: np.ndarray, other: LocalSurface, scene: LocalSurface) -> Overlap:
        return overlap(own, way, other, scene, noise, settings.sample, settings.overlap)

    there, back = each(fits, parts, ways, parts.swapped, surfaces.swapped)
    return Match(transform, there, back, settings=settings)
