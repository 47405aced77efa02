"""The points of a cloud in cylinders: how many there are in each, and where they lie along its axis.

A compiled kernel packs the points into a tree of boxes, and looks at eight boxes or points at a time. Without it
SciPy's k-d tree finds the points in spheres along each axis. Every cylinder is computed by itself: its figures do not
depend on what else is computed, or by how many threads.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial import cKDTree

from gmmjax import native
from gmmjax._cores import available_cores


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

    @property
    def spheres(self) -> Int[np.ndarray, " n"]:
        """The number of spheres about the axis that cover each cylinder, none much wider than it is."""
        return np.maximum(np.ceil(self.half_lengths / self.radii), 1).astype(np.int64)


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

    @classmethod
    def of_none(cls, cylinders: int) -> "Projections":
        """Without points in any cylinder."""
        return cls(np.zeros(cylinders, np.int64), np.full(cylinders, np.nan), np.full(cylinders, np.nan))

    @classmethod
    def joined(cls, parts: Iterable["Projections"]) -> "Projections":
        """Those of all cylinders, one part after the other."""
        found = list(parts)
        names = (field.name for field in dataclasses.fields(cls))
        return cls(*(np.concatenate([getattr(part, name) for part in found]) for name in names))


Search = Callable[[Cylinders], Projections]
"""Projects the points of a cloud to the axes of the cylinders that they are in; several threads may call it at once."""


def projections(points: Float64[np.ndarray, "m 3"], cylinders: Cylinders) -> Projections:
    """The points of a cloud in each of the cylinders, projected to its axis.

    Coordinates are subtracted from each other in float64 before anything else: those of a country's grid lose nothing.

    Args:
        points: finite coordinates, any number.
        cylinders: any number.
    """
    if not len(points) or not len(cylinders):
        return Projections.of_none(len(cylinders))
    kernels, cores = native.host_kernels(), available_cores()
    if kernels is None:
        search, parts = _plain_search(points), _parts_that_fit(cylinders)
    else:
        search, parts = _native_search(points, kernels), _parts_for(cores, len(cylinders))
    if min(cores, len(parts)) < 2:
        return Projections.joined(search(cylinders.part(chosen)) for chosen in parts)
    with ThreadPoolExecutor(min(cores, len(parts))) as pool:
        return Projections.joined(pool.map(search, [cylinders.part(chosen) for chosen in parts]))


def _parts_for(threads: int, cylinders: int, fewest: int = 256) -> list[slice]:
    """Slices of a number of cylinders for so many threads; fewer than some hundred are not worth a thread."""
    count = max(1, min(threads, cylinders // fewest))
    edges = [cylinders * part // count for part in range(count + 1)]
    return list(itertools.starmap(slice, itertools.pairwise(edges)))


def _parts_that_fit(cylinders: Cylinders, max_spheres: int = 20_000) -> list[slice]:
    """Slices of the cylinders with about so many spheres each: what is computed of them must fit into memory."""
    return _parts_by_size(cylinders.spheres, max_spheres)


def _parts_by_size(sizes: Int[np.ndarray, " n"], most: int) -> list[slice]:
    """Slices of a number of things whose sizes sum up to about so much each."""
    last = np.cumsum(sizes) // most
    edges = [0, *(np.flatnonzero(np.diff(last)) + 1), len(sizes)]
    return list(itertools.starmap(slice, itertools.pairwise(edges)))


def _native_search(points: Float64[np.ndarray, "m 3"], kernels: ModuleType) -> Search:
    """The search by the compiled kernel."""
    packed = kernels.packed_points(np.ascontiguousarray(points))

    def search(cylinders: Cylinders) -> Projections:
        found = Projections.of_none(len(cylinders))
        given = (np.ascontiguousarray(getattr(cylinders, field.name)) for field in dataclasses.fields(cylinders))
        kernels.projections(packed, *given, found.count, found.mean, found.variance)
        return found

    return search


def _plain_search(points: Float64[np.ndarray, "m 3"]) -> Search:
    """The search with SciPy's k-d tree."""
    # The slack of the spheres must be more than the rounding of coordinates.
    offset = points[0]
    points = points - offset
    tree = cKDTree(points)

    def search(cylinders: Cylinders, max_points: int = 1_000_000) -> Projections:
        centred = dataclasses.replace(cylinders, centres=cylinders.centres - offset)
        # Near a scanner a cylinder has thousands of times as many points as far from it.
        spheres = _Spheres.of(centred)
        found = np.bincount(spheres.owner, tree.query_ball_point(*spheres.balls, return_length=True), len(cylinders))
        parts = _parts_by_size(found.astype(np.int64), max_points)
        return Projections.joined(_projections_of_part(points, tree, centred.part(chosen)) for chosen in parts)

    return search


class _Spheres(NamedTuple):
    """Spheres along the axes of cylinders, that cover them.

    Attributes:
        owner: the cylinder of each.
        piece: which one of its spheres.
        length: of the piece of the axis that it covers.
        balls: their centres and radii.
    """

    owner: Int[np.ndarray, " s"]
    piece: Int[np.ndarray, " s"]
    length: Float64[np.ndarray, " s"]
    balls: tuple[Float64[np.ndarray, "s 3"], Float64[np.ndarray, " s"]]

    @classmethod
    def of(cls, cylinders: Cylinders, slack: float = 1e-9) -> "_Spheres":
        """Those of some cylinders.

        Args:
            cylinders: that they cover.
            slack: by which they are larger than they need be, as a fraction: more than the rounding of coordinates.
        """
        spheres = cylinders.spheres
        owner = np.repeat(np.arange(len(cylinders)), spheres)
        piece = np.arange(len(owner)) - np.repeat(np.cumsum(spheres) - spheres, spheres)
        length = (2 * cylinders.half_lengths / spheres)[owner]
        along = (piece + 0.5) * length - cylinders.half_lengths[owner]
        centres = cylinders.centres[owner] + along[:, None] * cylinders.axes[owner]
        return cls(owner, piece, length, (centres, np.hypot(cylinders.radii[owner], length / 2) * (1 + slack)))


def _projections_of_part(points: Float64[np.ndarray, "m 3"], tree: cKDTree, cylinders: Cylinders) -> Projections:
    """`projections` with the tree of the points, for as many cylinders as fit into memory."""
    owner, projected = _points_inside(points, tree, cylinders)
    count = np.bincount(owner, minlength=len(cylinders))
    with np.errstate(invalid="ignore"):
        mean = np.bincount(owner, projected, len(cylinders)) / count
        squares = np.bincount(owner, (projected - mean[owner]) ** 2, len(cylinders))
        variance = np.where(count > 1, squares / (count - 1), np.nan)
    return Projections(count, mean, variance)


def _points_inside(
    points: Float64[np.ndarray, "m 3"], tree: cKDTree, cylinders: Cylinders
) -> tuple[Int[np.ndarray, " f"], Float64[np.ndarray, " f"]]:
    """For each point in a cylinder, the cylinder's index and the point's projection to its axis."""
    owner, piece, length, balls = _Spheres.of(cylinders)
    lists = tree.query_ball_point(*balls)
    sizes = np.fromiter(map(len, lists), np.int64, len(lists))
    indices = np.concatenate([np.asarray(found, np.int64) for found in (*lists, [])])
    owner, piece, length = (np.repeat(values, sizes) for values in (owner, piece, length))

    offsets, axes, half = (
        points[indices] - cylinders.centres[owner],
        cylinders.axes[owner],
        cylinders.half_lengths[owner],
    )
    projected = (offsets * axes).sum(axis=1)
    squared = ((offsets - projected[:, None] * axes) ** 2).sum(axis=1)
    # A point is of one piece of the cylinder, though it may lie in several of the spheres.
    own = np.minimum((projected + half) // length, cylinders.spheres[owner] - 1) == piece
    inside = own & (np.abs(projected) <= half) & (squared <= cylinders.radii[owner] ** 2)
    return owner[inside], projected[inside]
