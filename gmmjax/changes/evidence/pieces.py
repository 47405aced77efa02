"""Candidates cut into pieces that are one thing each: an object, and the wall behind it that it occluded.

They are cut where they begin to continue an unchanged surface, where what the other survey saw through ends, and at
gaps. They are not cut where they bend: faces of one object, judged one by one, are judged no better (docs/verdict.md).
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from gmmjax.changes.evidence.continuation import Continuation, ContinuationSettings
from gmmjax.changes.evidence.coverage_edge import ReferenceSurfaces
from gmmjax.geometry import density_clusters, nearest_neighbours


@dataclasses.dataclass(frozen=True)
class PieceSettings:
    """How candidates are cut, and how pieces that are changes become one again.

    Attributes:
        smallest: number of points of a piece, at least; what is smaller stays with the piece next to it. Smaller:
            pieces are judged by their noise.
        share: and its fraction of the candidate. 1: candidates are judged as a whole, an object with its shadow.
        radius: of the clusters that are pieces, in spacings (the radius of DBSCAN). Smaller: the gaps between points
            split them.
        neighbours: the minimum of DBSCAN, the point itself counted. 1: outliers connect pieces.
        nearest: number of points, the point itself counted, by most of which it is told whether a place was seen
            through. 1: single lines of sight cut objects into crumbs.
    """

    smallest: int = 60
    share: float = 0.1
    radius: float = 5.0
    neighbours: int = 8
    nearest: int = 15


def cut(
    points: Float[np.ndarray, "n 3"],
    labels: Int[np.ndarray, " n"],
    reference: ReferenceSurfaces,
    free: Bool[np.ndarray, " n"] | None = None,
    settings: PieceSettings = PieceSettings(),
    continued: ContinuationSettings = ContinuationSettings(),
) -> tuple[Int[np.ndarray, " n"], dict[int, Continuation]]:
    """The pieces of all candidates of a cloud, and how each continues the surfaces beside it.

    Args:
        points: of one cloud.
        labels: -1, or the number of the candidate.
        reference: the unchanged points of the cloud, and the other cloud.
        free: which points are in free space of the other survey; None: its views are not known.
        settings: how candidates are cut.
        continued: when a point continues a surface.

    Returns:
        For each point -1 or the number of its piece, without gaps; of each piece its continuation.
    """
    pieces, continuations = np.full(len(labels), -1), dict[int, Continuation]()
    for label in np.unique(labels[labels >= 0]):
        own = np.flatnonzero(labels == label)
        whole = Continuation(points[own], reference, continued)
        parts = _parts(whole, None if free is None else free[own], settings)
        for part in range(parts.max() + 1):
            number, inside = len(continuations), parts == part
            pieces[own[inside]] = number
            alone = parts.max() == 0
            continuations[number] = whole if alone else Continuation(points[own[inside]], reference, continued)
    return pieces, continuations


def _parts(whole: Continuation, free: Bool[np.ndarray, " m"] | None, settings: PieceSettings) -> Int[np.ndarray, " m"]:
    """The number of the piece of each point of one candidate."""
    points, spacing = whole.segment, whole.reference.spacing
    least = max(settings.smallest, settings.share * len(points))
    if len(points) < 2 * least:
        return np.zeros(len(points), int)
    parts = np.full(len(points), -1)
    for side in _sides(points, whole.continued, free, settings):
        if side.sum() < least:
            continue
        clusters = density_clusters(points[side], settings.radius * spacing, settings.neighbours)
        large = np.flatnonzero(np.bincount(clusters[clusters >= 0], minlength=1) >= least)
        for cluster in large:
            parts[np.flatnonzero(side)[clusters == cluster]] = parts.max() + 1
    if parts.max() < 1:
        return np.zeros(len(points), int)
    rest = parts < 0
    nearest = nearest_neighbours(cKDTree(points[~rest]), points[rest], 1)[1][:, 0]
    parts[rest] = parts[~rest][nearest]
    return parts


def _sides(
    points: Float[np.ndarray, "m 3"],
    continued: Bool[np.ndarray, " m"],
    free: Bool[np.ndarray, " m"] | None,
    settings: PieceSettings,
) -> list[Bool[np.ndarray, " m"]]:
    """The points of one candidate by whether they continue unchanged surfaces, and whether they were seen through."""
    sides = [continued, ~continued]
    if free is None:
        return sides
    nearest = nearest_neighbours(cKDTree(points), points, settings.nearest)[1]
    mostly = free[nearest].mean(axis=1) > 0.5
    return [side & seen for side in sides for seen in (mostly, ~mostly)]
