"""The rigid transform that lays one scanned object best onto another.

The numbers come from development on the scenes of docs/results.md.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.overlap import Overlap, overlap
from gmmjax.changes.objects.rigid_match import refined, rigid_matches
from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.geometry import LocalSurface, rotation_about
from gmmjax.pair import Pair, each

# Candidate transforms where the support planes are not known, and of those that keep an object upright.
TRANSFORMS, UPRIGHT_TRANSFORMS = 7, 4
# Points of either object that candidates are compared by; so many of the best are refined on more of them, unless more
# than this fraction of the points contradicts the best one.
COARSE_SAMPLE, REFINED, SAMPLE, REFINED_SAMPLE, MAX_CONTRADICTED = 200, 2, 800, 2000, 0.3
# Contradicted points cost this multiple of what covered points gain.
CONTRADICTION = 4.0
# Of the transforms that fit a symmetric object the one with the smallest rotation is taken: half a turn costs this
# fraction of the points.
ROTATION_PENALTY = 0.05
# Headings that an upright object is searched in; cosine of the angle between the support planes after the transform, at
# least, and their distance in standard deviations of the noise, at most.
HEADINGS, LEVEL, SAME_HEIGHT = 24, 0.9, 3.0


class Compared(NamedTuple):
    """Two objects that may be one.

    Attributes:
        parts: what disappeared from the before cloud, and what appeared in the after cloud.
        surfaces: of both clouds, registered.
        noise: standard deviation of the offset between local means of one surface.
        planes: what either stands on, if that is known.
    """

    parts: Pair[LocalSurface]
    surfaces: Pair[LocalSurface]
    noise: float
    planes: Pair[SupportPlane | None] = Pair(None, None)


class Match(NamedTuple):
    """The best transform from one object to another, and its fit.

    Attributes:
        transform: rigid transform [4, 4] from the first to the second.
        there: how the first one fits the second.
        back: how the second one fits the first.
        upright: whether it brings the support plane of the first one onto that of the second.
    """

    transform: Float[np.ndarray, "4 4"]
    there: Overlap
    back: Overlap
    upright: bool = False

    @property
    def fit(self) -> float:
        """The fraction of the objects that is covered, less what is contradicted."""
        return sum(side.covered - CONTRADICTION * side.contradicted for side in (self.there, self.back))

    @property
    def merit(self) -> float:
        """The rank of a transform; of equal ones, as of a symmetric object, the smallest rotation is first."""
        return self.fit - rotation_cost(self.transform)


def rotation_cost(transform: Float[np.ndarray, "4 4"]) -> float:
    """The loss of merit by the rotation of a transform."""
    return ROTATION_PENALTY * float(Rotation.from_matrix(transform[:3, :3]).magnitude()) / np.pi


def best_match(compared: Compared) -> Match | None:
    """Find the rigid transform that lays a disappeared object best onto an appeared one.

    Where both support planes are known, only transforms that keep the object upright are candidates: objects are put
    down on the side that they stood on, and two different boxes often fit each other when one may be tilted or sunk
    into the floor. None where no transform keeps the object upright.

    Args:
        compared: both objects.
    """
    first, second = compared.planes
    upright = first is not None and second is not None
    if first is None or second is None:
        candidates = rigid_matches(compared.parts, compared.noise, TRANSFORMS)
    else:
        candidates = _upright_candidates(compared, Pair(first, second))
    matches = [match_of(compared, transform, COARSE_SAMPLE) for transform in candidates]
    if not matches:
        return None
    matches.sort(key=lambda match: match.merit, reverse=True)
    best = matches[0]
    if min(best.there.contradicted, best.back.contradicted) <= MAX_CONTRADICTED:
        kept = [match.transform for match in matches[:REFINED]]
        finer = [refined(compared.parts, own, compared.noise, sample=REFINED_SAMPLE) for own in kept]
        best = max((match_of(compared, own) for own in (*finer, *kept)), key=lambda match: match.merit)
    return best._replace(upright=upright)


def match_of(compared: Compared, transform: Float[np.ndarray, "4 4"], sample: int = SAMPLE) -> Match:
    """Compare two objects after a known transform.

    Args:
        compared: both objects.
        transform: rigid transform [4, 4] from the first to the second.
        sample: number of points of either that are compared, at most.
    """
    (first, second), (before, after), noise, _ = compared
    back = np.linalg.inv(transform)
    return Match(
        transform,
        overlap(first, transform, second, after, noise, sample),
        overlap(second, back, first, before, noise, sample),
    )


def _upright_candidates(compared: Compared, planes: Pair[SupportPlane]) -> list[Float[np.ndarray, "4 4"]]:
    """The candidates that bring one support plane onto the other, from all headings."""
    start, goal = each(_foot, compared.parts, planes)
    level, _ = Rotation.align_vectors(planes.after.up[None], planes.before.up[None])
    turns = [Rotation.from_rotvec(2 * np.pi * step / HEADINGS * planes.after.up) for step in range(HEADINGS)]
    starts = np.stack([rotation_about((turn * level).as_matrix(), start, goal) for turn in turns])
    found = rigid_matches(compared.parts, compared.noise, UPRIGHT_TRANSFORMS, starts)
    return [transform for transform in found if _stays_upright(compared, planes, transform)]


def _foot(part: LocalSurface, plane: SupportPlane) -> Float64[np.ndarray, " 3"]:
    """The centroid of an object, projected onto its support plane."""
    centroid = part.points.mean(axis=0)
    return np.asarray(centroid - plane.above(centroid[None])[0] * plane.up)


def _stays_upright(compared: Compared, planes: Pair[SupportPlane], transform: Float[np.ndarray, "4 4"]) -> bool:
    """True where a transform brings one support plane onto the other, as far as the second object goes."""
    first, second = planes
    up, middle = transform[:3, :3] @ first.up, compared.parts.after.points.mean(axis=0)
    apart = abs(float(middle @ (up - second.up) - up @ transform[:3, 3]) - first.height + second.height)
    return bool(up @ second.up > LEVEL and apart < SAME_HEIGHT * compared.noise)
