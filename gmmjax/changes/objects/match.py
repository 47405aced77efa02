"""The rigid transform that lays one scanned object best onto another, and what is known of how well it fits."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.bare_support import BareSupportSettings, Footing
from gmmjax.changes.objects.overlap import Overlap, OverlapSettings, overlap
from gmmjax.changes.objects.rigid_match import RigidMatchSettings, refined_match, rigid_matches, rigid_matches_near
from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.changes.objects.top import Top, top_of
from gmmjax.changes.objects.upright import UprightSettings, stays_upright, upright_searches
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class MatchSettings:
    """How the transform between two objects is found.

    All values are empirical: they come from development on the scenes of docs/results.md. Heights are in
    standard deviations of the offset between local means of one surface.

    Attributes:
        transforms: number of candidate transforms where the support planes are not known.
        upright_transforms: number of those that keep an object upright, of the whole objects and of their tops each.
        coarse_sample: number of points of either object that every candidate is compared by.
        most_contradicted: fraction of the points above which the best candidate is not refined. 1: it always is.
        refined: number of candidates, the best, that are refined.
        sample: number of points of either object that a refined transform is compared by.
        contradiction: contradicted points cost this multiple of what covered points gain in the comparison of
            transforms. 0: contradictions do not count.
        bare_support: points over a bare support cost this multiple, in addition. 0: it does not count.
        rotation_penalty: fraction of the points that a rotation by 180 degrees costs there: of the transforms that fit
            a symmetric object the one with the smallest rotation is taken. 0: any of them.
        same_height: largest distance of the support planes after the transform. Infinite: objects may sink or float.
        other_height: objects whose tops differ in height by more are not compared: saves time. Infinite: all are.
        equal_tops: standard deviation of the difference of equal tops, of which the survey of either saw the edges a
            little differently. 0: no two tops are equal.
        overlap: when a point lies on a surface.
        bare: where a support is bare.
        rigid: how transforms are searched.
        upright: what objects stand on, and which transforms keep them upright.
    """

    transforms: int = 7
    upright_transforms: int = 4
    coarse_sample: int = 200
    most_contradicted: float = 0.3
    refined: int = 2
    sample: int = 800
    contradiction: float = 4.0
    bare_support: float = 2.0
    rotation_penalty: float = 0.05
    same_height: float = 3.0
    other_height: float = 12.0
    equal_tops: float = 3.0
    overlap: OverlapSettings = OverlapSettings()
    bare: BareSupportSettings = BareSupportSettings()
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
        bare: fraction of the points below which the other survey shows the bare support, both fractions added up; 0
            where the supports are not known.
        settings: how transforms are compared.
    """

    transform: Float[np.ndarray, "4 4"]
    there: Overlap
    back: Overlap
    upright: bool = False
    tops: Pair[Top] | None = None
    bare: float = 0.0
    settings: MatchSettings = MatchSettings()

    @property
    def fit(self) -> float:
        """How well the objects fit: what is covered, less what is contradicted and what stands over a bare support."""
        contradiction = self.settings.contradiction
        fits = sum(side.covered - contradiction * side.contradicted for side in (self.there, self.back))
        return fits - self.settings.bare_support * self.bare

    @property
    def merit(self) -> float:
        """What transforms are ranked by; of equal ones, as of a symmetric object, the smallest rotation is first."""
        half_turns = Rotation.from_matrix(self.transform[:3, :3]).magnitude() / np.pi
        return float(self.fit - self.settings.rotation_penalty * half_turns)


class _Candidates(NamedTuple):
    """Candidate transforms, whether they keep the object upright, and the tops of both objects."""

    transforms: Sequence[Float[np.ndarray, "4 4"]]
    upright: bool
    tops: Pair[Top] | None


def best_match(
    parts: Pair[LocalSurface],
    surfaces: Pair[LocalSurface],
    noise: float,
    footings: Pair[Footing | None] = Pair(None, None),
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
        footings: where either stands, if its support plane is known.
        settings: how the transform is found.

    Returns:
        The match; None where no transform keeps the object upright.
    """

    def matched(transform: np.ndarray, sample: int) -> Match:
        return match_of(parts, transform, surfaces, noise, dataclasses.replace(settings, sample=sample), footings)

    def refined(match: Match) -> Match:
        finer = refined_match(parts.before, parts.after, match.transform, noise, settings.rigid)
        return max((matched(own, settings.sample) for own in (finer, match.transform)), key=lambda own: own.merit)

    candidates = _candidates(parts, noise, footings, settings)
    if not candidates.transforms:
        return None
    matches = [matched(transform, settings.coarse_sample) for transform in candidates.transforms]
    matches.sort(key=lambda match: match.merit, reverse=True)
    best = matches[0]
    if min(best.there.contradicted, best.back.contradicted) <= settings.most_contradicted:
        best = max((refined(match) for match in matches[: settings.refined]), key=lambda match: match.merit)
    return best._replace(upright=candidates.upright, tops=candidates.tops)


def _candidates(
    parts: Pair[LocalSurface], noise: float, footings: Pair[Footing | None], settings: MatchSettings
) -> _Candidates:
    if footings.before is None or footings.after is None:
        return _Candidates(
            rigid_matches(parts.before, parts.after, noise, settings.transforms, settings.rigid), False, None
        )
    return _upright_candidates(parts, noise, Pair(footings.before.plane, footings.after.plane), settings)


def _upright_candidates(
    parts: Pair[LocalSurface], noise: float, planes: Pair[SupportPlane], settings: MatchSettings
) -> _Candidates:
    """The candidates that keep the object upright; none where the tops differ in height."""
    upright = settings.upright
    first, second = each(lambda part, plane: top_of(part, plane, noise, upright.top), parts, planes)
    tops = None if first is None or second is None else Pair(first, second)
    if tops is not None and abs(tops.before.height - tops.after.height) > settings.other_height * noise:
        return _Candidates([], True, tops)
    searches = upright_searches(parts, planes, upright)
    found = rigid_matches_near(parts.before, parts.after, searches, noise, settings.upright_transforms, settings.rigid)
    middle, tolerance = parts.after.points.mean(axis=0), settings.same_height * noise
    kept = [transform for transform in found if stays_upright(transform, planes, middle, tolerance, upright)]
    return _Candidates(kept, True, tops)


def match_of(
    parts: Pair[LocalSurface],
    transform: Float[np.ndarray, "4 4"],
    surfaces: Pair[LocalSurface],
    noise: float,
    settings: MatchSettings = MatchSettings(),
    footings: Pair[Footing | None] = Pair(None, None),
) -> Match:
    """How well a known transform lays the one object onto the other.

    Args:
        parts: both objects.
        transform: rigid transform [4, 4] from the first to the second.
        surfaces: of both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.
        settings: how many points are compared, and when they lie on a surface.
        footings: where either stands, if its support plane is known.
    """
    ways = Pair(transform, np.linalg.inv(transform))

    def fits(own: LocalSurface, way: np.ndarray, other: LocalSurface, scene: LocalSurface) -> Overlap:
        return overlap(own, way, other, scene, noise, settings.sample, settings.overlap)

    def bare(own: LocalSurface, way: np.ndarray, footing: Footing | None) -> float:
        return 0.0 if footing is None else footing.bare_share(own, way)

    there, back = each(fits, parts, ways, parts.swapped, surfaces.swapped)
    return Match(transform, there, back, bare=sum(each(bare, parts, ways, footings.swapped)), settings=settings)
