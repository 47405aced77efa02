"""What is known of a match between two objects, in numbers without a unit: what the probability is computed from."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64

from gmmjax.changes.objects.match import Match
from gmmjax.geometry import LocalSurface, transformed
from gmmjax.pair import Pair


class MatchFacts(NamedTuple):
    """The facts of a match; each is finite, and of moderate size.

    Attributes:
        covered_least: fraction of the points that lie on the other object, of the object where it is smaller.
        covered_most: of the object where it is larger.
        explained: of the changes, the fraction that lies on the other object, as `InPlaceMotion.explained`. All of an
            object that was put elsewhere is a change: there it is `covered_least`.
        contradicted: square root of the fraction of the points that the other survey must have observed, but did not,
            both fractions added up.
        bare: square root of the fraction of the points below which the other survey shows the bare support, of both
            objects added up; 0 where the supports are not known.
        residual: root mean square offset of the covered points, in standard deviations of the noise; the mean of both.
        overhang_least: how far an object reaches beyond the other's hull, logarithm of one plus standard deviations of
            the noise, the smaller of both.
        overhang_most: the larger of both.
        height_difference: of the tops above their support planes, logarithm of one plus standard deviations of the
            noise; 0 where the tops are not known.
        outline_difference: of the sides of the tops' outlines, likewise.
        tops_known: 1 where both tops are known, else 0.
        tops_agree: 1 where both tops have the same height and outline, towards 0 where they differ by several standard
            deviations of the noise; 0 where the tops are not known.
        observability: how well the normals determine a translation, of the object where it is less: 0 where it can
            slide along itself, as a plane or a pipe can.
        width: logarithm of the second principal extent of the smaller object, in spacings, at most that of 15.
        thickness: of the third one, at most that of 10.
        fewest_points: logarithm of the number of points of the object that has fewer, at most that of 500.
        distance: that the object's middle moves beyond its radius, in radii, at most 1: what moved within its place
            overlaps the place where it was.
    """

    covered_least: float
    covered_most: float
    explained: float
    contradicted: float
    bare: float
    residual: float
    overhang_least: float
    overhang_most: float
    height_difference: float
    outline_difference: float
    tops_known: float
    tops_agree: float
    observability: float
    width: float
    thickness: float
    fewest_points: float
    distance: float

    def vector(self) -> Float64[np.ndarray, " f"]:
        """The facts in their order."""
        return np.array(self, np.float64)


def match_facts(match: Match, parts: Pair[LocalSurface], noise: float, explained: float | None = None) -> MatchFacts:
    """The facts of a match.

    Args:
        match: of the two objects.
        parts: what disappeared from the before cloud, and what appeared in the after cloud.
        noise: standard deviation of the offset between local means of one surface.
        explained: of the changes, the fraction that lies on the other object; None: all of both objects is a change.
    """
    sides = (match.there, match.back)
    covered, overhang = [side.covered for side in sides], [float(np.log1p(side.overhang)) for side in sides]
    height, outline = _top_differences(match, noise)
    tops_known = float(match.tops is not None)
    smaller = min(parts, key=lambda part: _radius(part.points))
    spacing = max(part.nearest_distance for part in parts)
    extents = principal_extents(smaller.points)
    middle = parts.before.points.mean(axis=0)
    moved_by = float(np.linalg.norm(transformed(middle[None], match.transform)[0] - middle))
    return MatchFacts(
        covered_least=min(covered),
        covered_most=max(covered),
        explained=min(covered) if explained is None else explained,
        contradicted=float(np.sqrt(sum(side.contradicted for side in sides))),
        bare=float(np.sqrt(match.bare)),
        residual=sum(side.residual for side in sides) / 2,
        overhang_least=min(overhang),
        overhang_most=max(overhang),
        height_difference=float(np.log1p(height)),
        outline_difference=float(np.log1p(outline)),
        tops_known=tops_known,
        tops_agree=tops_known * float(np.exp(-(height**2 + outline**2) / 2 / match.settings.equal_tops**2)),
        observability=min(float(observability(part)[0]) for part in parts),
        width=float(np.log(np.clip(extents[1] / spacing, 0.1, 15.0))),
        thickness=float(np.log(np.clip(extents[2] / spacing, 0.1, 10.0))),
        fewest_points=float(np.log(min(500, *(len(part) for part in parts)))),
        distance=float(np.clip(moved_by / _radius(smaller.points) - 1.0, 0.0, 1.0)),
    )


def principal_extents(points: Float[np.ndarray, "n 3"]) -> Float64[np.ndarray, " 3"]:
    """The extents along the principal axes, longest first, of points that fill them evenly: sqrt 12 deviations."""
    variances = np.linalg.eigvalsh(np.cov(points.T, bias=True))
    return np.asarray(np.sqrt(12 * np.maximum(variances[::-1], 0)))


def observability(part: LocalSurface) -> Float64[np.ndarray, " 3"]:
    """How well the normals of an object determine its translation, least first: 0 where it can slide along itself.

    The square roots of the eigenvalues of the normal equations of point-to-plane ICP for translations (Gelfand,
    Ikemoto, Rusinkiewicz and Levoy 2003): one of them is 0 for a pipe, two for a plane.
    """
    information = np.linalg.eigvalsh(part.normals.T @ part.normals / len(part))
    return np.asarray(np.sqrt(np.maximum(information, 0)))


def _top_differences(match: Match, noise: float) -> tuple[float, float]:
    """Of the tops' heights, and the larger one of their outlines' sides, in standard deviations of the noise."""
    if match.tops is None:
        return 0.0, 0.0
    first, second = match.tops
    return abs(first.height - second.height) / noise, float(np.abs(first.sides - second.sides).max()) / noise


def _radius(points: Float[np.ndarray, "n 3"]) -> float:
    return max(float(np.sqrt(points.var(axis=0).sum())), np.finfo(np.float64).tiny)
