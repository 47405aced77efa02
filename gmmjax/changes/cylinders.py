"""The points of a cloud in cylinders: how many there are in each, and where they lie along its axis.

A compiled kernel packs the points into a tree of boxes, and looks at eight boxes or points at a time. Without it
SciPy's k-d tree finds the points in spheres along each axis. Every cylinder is computed by itself: its figures do not
depend on what else is computed, or by how many threads.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial import cKDTree

from gmmjax import native
from gmmjax._cores import available_cores
from gmmjax.clouds import morton_order


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

    def part(self, chosen: slice | Int[np.ndarray, " m"]) -> "Cylinders":
        """Some of the cylinders."""
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
    def joined(cls, parts: Iterable["Projections"], order: Int[np.ndarray, " n"]) -> "Projections":
        """Those of all cylinders, from those of parts that are in another order."""
        parts, back = list(parts), np.argsort(order)
        names = (field.name for field in dataclasses.fields(cls))
        return cls(*(np.concatenate([getattr(part, name) for part in parts])[back] for name in names))


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
    kernels = native.host_kernels()
    search = _plain_search(points) if kernels is None else _native_search(points, kernels)
    # Neighbours look up the same points, which are still in the cache then.
    order = morton_order(cylinders.centres)
    ordered = cylinders.part(order)
    parts = [ordered.part(chosen) for chosen in _parts(ordered)]
    threads = min(available_cores(), len(parts))
    if threads < 2:
        return Projections.joined(map(search, parts), order)
    with ThreadPoolExecutor(threads) as pool:
        return Projections.joined(pool.map(search, parts), order)


def _parts(cylinders: Cylinders, most_spheres: int = 20_000) -> Iterator[slice]:
    """Slices of the cylinders with about so many spheres each: what is found in them must fit into memory."""
    last = np.cumsum(cylinders.spheres) // most_spheres
    for start, stop in itertools.pairwise([0, *(np.flatnonzero(np.diff(last)) + 1), len(cylinders)]):
        yield slice(start, stop)


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
    # The spheres have some slack, which must be more than the rounding of coordinates.
    offset = points[0]
    points = points - offset
    tree = cKDTree(points)

    def search(cylinders: Cylinders) -> Projections:
        centred = dataclasses.replace(cylinders, centres=cylinders.centres - offset)
        owner, projected = _points_inside(points, tree, centred)
        count = np.bincount(owner, minlength=len(cylinders))
        with np.errstate(invalid="ignore"):
            mean = np.bincount(owner, projected, len(cylinders)) / count
            squares = np.bincount(owner, (projected - mean[owner]) ** 2, len(cylinders))
            variance = np.where(count > 1, squares / (count - 1), np.nan)
        return Projections(count, mean, variance)

    return search


def _points_inside(
    points: Float64[np.ndarray, "m 3"], tree: cKDTree, cylinders: Cylinders, slack: float = 1e-9
) -> tuple[Int[np.ndarray, " f"], Float64[np.ndarray, " f"]]:
    """For each point in a cylinder, the cylinder's index and the point's projection to its axis.

    Args:
        points: of the cloud.
        tree: of the points.
        cylinders: about which spheres are looked up.
        slack: by which these are larger than they need be, as a fraction.
    """
    spheres = cylinders.spheres
    owner = np.repeat(np.arange(len(cylinders)), spheres)
    piece = np.arange(len(owner)) - np.repeat(np.cumsum(spheres) - spheres, spheres)
    length = (2 * cylinders.half_lengths / spheres)[owner]
    along = (piece + 0.5) * length - cylinders.half_lengths[owner]
    centres = cylinders.centres[owner] + along[:, None] * cylinders.axes[owner]
    lists = tree.query_ball_point(centres, np.hypot(cylinders.radii[owner], length / 2) * (1 + slack))
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
    own = np.minimum((projected + half) // length, spheres[owner] - 1) == piece
    inside = own & (np.abs(projected) <= half) & (squared <= cylinders.radii[owner] ** 2)
    return owner[inside], projected[inside]
