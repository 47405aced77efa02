"""Whether two scanned objects are one: the rigid transform that lays one best onto the other, and how well it fits."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.overlap import Overlap, OverlapSettings, overlap
from gmmjax.changes.objects.rigid_match import RigidMatchSettings, refined_match, rigid_matches, rigid_matches_near
from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.changes.objects.top import top_of
from gmmjax.changes.objects.upright import UprightSettings, stays_upright, upright_transforms
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class MatchSettings:
    """When two objects are one, and how the transform between them is found.

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
        uncovered: in the misfit a point that is not covered costs this fraction of a contradicted one. 0: nothing.
        most_misfit: of one object, both directions together. Infinite: any two objects that overlap are one.
        least_covered: fraction of either one that lies on the other. 0: objects may be matched without an overlap.
        least_covered_upright: the same where the support planes are known.
        most_misfit_same_top: of one object, where the tops have the same outline and height, which two objects rarely
            have. Equal to `most_misfit`: equal tops gain nothing.
        least_covered_same_top: the same, of the fraction that lies on the other one.
        same_height: largest distance of the support planes after the transform. Infinite: objects may sink or float.
        other_height: objects whose tops differ in height by more are not compared. Infinite: all are.
        overlap: when a point lies on a surface.
        rigid: how transforms are searched.
        upright: what objects stand on, and which transforms keep them upright.
    """

    transforms: int = 10
    upright_transforms: int = 24
    coarse_sample: int = 200
    most_contradicted: float = 0.3
    refined: int = 2
    sample: int = 800
    contradiction: float = 4.0
    rotation_penalty: float = 0.05
    uncovered: float = 0.02
    most_misfit: float = 0.07
    least_covered: float = 0.45
    least_covered_upright: float = 0.3
    most_misfit_same_top: float = 0.3
    least_covered_same_top: float = 0.2
    same_height: float = 3.0
    other_height: float = 8.0
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
        same_top: whether both have a top of the same outline and height.
        settings: what is one object.
    """

    transform: Float[np.ndarray, "4 4"]
    there: Overlap
    back: Overlap
    upright: bool = False
    same_top: bool = False
    settings: MatchSettings = MatchSettings()

    @property
    def limits(self) -> tuple[float, float]:
        """Of one object: the largest misfit, and the least covered fraction."""
        settings = self.settings
        if self.same_top:
            return settings.most_misfit_same_top, settings.least_covered_same_top
        if self.upright:
            return settings.most_misfit, settings.least_covered_upright
        return settings.most_misfit, settings.least_covered

    @property
    def misfit(self) -> float:
        """Contradicted fraction of both, with a small part of the uncovered one; infinite below the least overlap."""
        if min(self.there.covered, self.back.covered) < self.limits[1]:
            return float("inf")
        uncovered = self.settings.uncovered
        return sum(side.contradicted + uncovered * (1 - side.covered) for side in (self.there, self.back))

    @property
    def one_object(self) -> bool:
        """Whether the two are one object."""
        return self.misfit <= self.limits[0]

    @property
    def merit(self) -> float:
        """What transforms are ranked by; of equal ones, as of a symmetric object, the smallest rotation is first."""
        half_turns = Rotation.from_matrix(self.transform[:3, :3]).magnitude() / np.pi
        contradiction = self.settings.contradiction
        fits = sum(side.covered - contradiction * side.contradicted for side in (self.there, self.back))
        return float(fits - self.settings.rotation_penalty * half_turns)


class _Candidates(NamedTuple):
    """Candidate transforms, whether they keep the object upright, and whether both objects have the same top."""

    transforms: Sequence[Float[np.ndarray, "4 4"]]
    upright: bool
    same_top: bool


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
        return matches[0]
    best = max(
        (_refined(parts, match, surfaces, noise, settings) for match in matches[: settings.refined]),
        key=lambda match: match.merit,
    )
    return best._replace(upright=candidates.upright, same_top=candidates.same_top)


def _candidates(
    parts: Pair[LocalSurface], noise: float, stood_on: Pair[SupportPlane | None], settings: MatchSettings
) -> _Candidates:
    if stood_on.before is None or stood_on.after is None:
        return _Candidates(
            rigid_matches(parts.before, parts.after, noise, settings.transforms, settings.rigid), False, False
        )
    return _upright_candidates(parts, noise, Pair(stood_on.before, stood_on.after), settings)


def _upright_candidates(
    parts: Pair[LocalSurface], noise: float, planes: Pair[SupportPlane], settings: MatchSettings
) -> _Candidates:
    """The candidates that keep the object upright; none where the tops differ in height."""
    upright = settings.upright
    tops = each(lambda part, plane: top_of(part, plane, noise, upright.top), parts, planes)
    same_top = False
    if tops.before is not None and tops.after is not None:
        if abs(tops.before.height - tops.after.height) > settings.other_height * noise:
            return _Candidates([], True, False)
        same_top = tops.before.equals(tops.after, noise, upright.top)
    starts = upright_transforms(parts, planes, upright)
    found = rigid_matches_near(parts.before, parts.after, starts, noise, settings.upright_transforms, settings.rigid)
    middle, tolerance = parts.after.points.mean(axis=0), settings.same_height * noise
    kept = [transform for transform in found if stays_upright(transform, planes, middle, tolerance, upright)]
    return _Candidates(kept, True, same_top)


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
    inverse = np.linalg.inv(transform)
    there = overlap(parts.before.moved(transform), parts.after, surfaces.after, noise, sample, settings.overlap)
    back = overlap(parts.after.moved(inverse), parts.before, surfaces.before, noise, sample, settings.overlap)
    return Match(transform, there, back, settings=settings)
