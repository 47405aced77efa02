"""The points of a cloud in cylinders: how many there are in each, and where they lie along its axis.

The k-d tree finds the points in spheres along an axis, and those of them count that are in the cylinder. Every cylinder
is computed by itself: its figures do not depend on what else is computed, or by how many threads.
"""

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial import cKDTree

from gmmjax.geometry import workers_for


@dataclasses.dataclass(frozen=True, eq=False)
class Cylinders:
    """Cylinders with flat ends.

    Attributes:
        centres: halfway between the ends.
        axes: unit vectors.
        radii: positive, in the unit of the points.
        half_lengths: positive, from the centre to either end.
    """

    centres: Float64[np.ndarray, "n 3"]
    axes: Float64[np.ndarray, "n 3"]
    radii: Float64[np.ndarray, " n"]
    half_lengths: Float64[np.ndarray, " n"]

    def __len__(self) -> int:
        return len(self.centres)

    def part(self, chosen: slice) -> "Cylinders":
        """Some of the cylinders, without a copy."""
        return Cylinders(self.centres[chosen], self.axes[chosen], self.radii[chosen], self.half_lengths[chosen])


@dataclasses.dataclass(frozen=True, eq=False)
class Projections:
    """The points in each cylinder, projected to its axis.

    Attributes:
        count: number of the points.
        mean: of their projections, from the cylinder's centre; NaN without points.
        variance: of their projections, with n - 1; NaN for fewer than two.
    """

    count: Int[np.ndarray, " n"]
    mean: Float64[np.ndarray, " n"]
    variance: Float64[np.ndarray, " n"]


def projections(points: Float64[np.ndarray, "m 3"], cylinders: Cylinders) -> Projections:
    """The points of a cloud in each of the cylinders, projected to its axis.

    Coordinates are subtracted from each other in float64 before anything else: those of a country's grid lose nothing.

    Args:
        points: finite coordinates, any number.
        cylinders: any number.
    """
    if not len(points) or not len(cylinders):
        return _of_none(len(cylinders))
    # Spheres are looked up with some slack, which must be more than the rounding of the coordinates.
    offset = points[0]
    centred = dataclasses.replace(cylinders, centres=cylinders.centres - offset)
    points = points - offset
    tree = cKDTree(points)
    parts = [_plain_projections(points, tree, centred.part(chosen)) for chosen in _parts(centred)]
    return Projections(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("count", "mean", "variance"))
    )


def _of_none(count: int) -> Projections:
    return Projections(np.zeros(count, np.int64), np.full(count, np.nan), np.full(count, np.nan))


def _spheres(cylinders: Cylinders) -> Int[np.ndarray, " n"]:
    """The number of spheres that cover each cylinder: none is much wider than the cylinder."""
    return np.maximum(np.ceil(cylinders.half_lengths / cylinders.radii), 1).astype(np.int64)


def _parts(cylinders: Cylinders, most_spheres: int = 20_000) -> Iterator[slice]:
    """Slices of the cylinders with so many spheres each, about: the points in them must fit into memory."""
    last = np.cumsum(_spheres(cylinders)) // most_spheres
    edges = [0, *(np.flatnonzero(np.diff(last)) + 1), len(cylinders)]
    for start, stop in itertools.pairwise(edges):
        yield slice(start, stop)


def _plain_projections(points: Float64[np.ndarray, "m 3"], tree: cKDTree, cylinders: Cylinders) -> Projections:
    """The projections, with SciPy's k-d tree."""
    owner, projected = _found(points, tree, cylinders)
    count = np.bincount(owner, minlength=len(cylinders))
    with np.errstate(invalid="ignore"):
        mean = np.bincount(owner, projected, len(cylinders)) / count
        squares = np.bincount(owner, (projected - mean[owner]) ** 2, len(cylinders))
        variance = np.where(count > 1, squares / (count - 1), np.nan)
    return Projections(count, mean, variance)


def _found(
    points: Float64[np.ndarray, "m 3"], tree: cKDTree, cylinders: Cylinders, slack: float = 1e-9
) -> tuple[Int[np.ndarray, " f"], Float64[np.ndarray, " f"]]:
    """For each point in a cylinder the cylinder's index, and the point's projection to its axis."""
    spheres = _spheres(cylinders)
    owner = np.repeat(np.arange(len(cylinders)), spheres)
    piece = np.arange(len(owner)) - np.repeat(np.cumsum(spheres) - spheres, spheres)
    length = (2 * cylinders.half_lengths / spheres)[owner]
    along = (piece + 0.5) * length - cylinders.half_lengths[owner]
    centres = cylinders.centres[owner] + along[:, None] * cylinders.axes[owner]
    radii = np.hypot(cylinders.radii[owner], length / 2) * (1 + slack)
    lists = tree.query_ball_point(centres, radii, workers=workers_for(len(centres)), return_sorted=True)
    sizes = np.fromiter(map(len, lists), np.int64, len(lists))
    indices = np.concatenate([np.asarray(found, np.int64) for found in lists])
    owner, piece, length = (np.repeat(values, sizes) for values in (owner, piece, length))

    offsets = points[indices] - cylinders.centres[owner]
    axes, half = cylinders.axes[owner], cylinders.half_lengths[owner]
    projected = (offsets * axes).sum(axis=1)
    from_axis = ((offsets - projected[:, None] * axes) ** 2).sum(axis=1)
    # A point is of one piece of the cylinder, though it may lie in several of the spheres.
    own = np.minimum((projected + half) // length, spheres[owner] - 1) == piece
    inside = own & (np.abs(projected) <= half) & (from_axis <= cylinders.radii[owner] ** 2)
    return owner[inside], projected[inside]
