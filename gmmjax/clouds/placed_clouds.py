"""Two clouds that are read in chunks, in the frame of the before cloud, and the blocks that they make."""

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.clouds.blocks import BlockSettings, BlockTree, block_tree
from gmmjax.clouds.cell_counts import Lattice, count_cells
from gmmjax.clouds.chunked_cloud import ChunkedCloud
from gmmjax.clouds.cloud_file import CHUNK_POINTS, CloudChunk
from gmmjax.clouds.read_both import read_both
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.pair import Pair, each


class StoredPoints(NamedTuple):
    """Points of a cloud.

    Attributes:
        points: coordinates relative to an offset.
        rows: of the cloud that they are from.
    """

    points: Float64[np.ndarray, "n 3"]
    rows: Int64[np.ndarray, " n"]

    def part(self, chosen: Int64[np.ndarray, " m"] | slice) -> "StoredPoints":
        """Some of the points."""
        return StoredPoints(self.points[chosen], self.rows[chosen])


@dataclasses.dataclass(frozen=True, eq=False)
class PlacedClouds:
    """Two clouds and how they lie to each other.

    Attributes:
        clouds: both, each in a frame of its own.
        transform: rigid transform that takes the after cloud into the frame of the before cloud; None: they are in one.
        progress: called with a message and the share of the rows that were read, each time that both clouds are read;
            from any thread.
    """

    clouds: Pair[ChunkedCloud]
    transform: Float64[np.ndarray, "4 4"] | None = None
    progress: Callable[[str, float], None] | None = None

    @property
    def row_counts(self) -> Pair[int]:
        """The number of rows of either cloud."""
        return self.clouds.map(lambda own: own.count)

    @property
    def transforms(self) -> Pair[Float64[np.ndarray, "4 4"] | None]:
        """What takes either cloud into the frame of the before cloud; None: nothing has to."""
        return Pair(None, self.transform)

    def chunks(self, lattice: Lattice) -> Pair[Iterator[StoredPoints]]:
        """The points of either cloud relative to the lattice's offset, some at a time."""
        total, read = max(sum(self.row_counts), 1), {0: 0, 1: 0}

        def placed(
            cloud: ChunkedCloud, transform: Float64[np.ndarray, "4 4"] | None, side: int
        ) -> Iterator[StoredPoints]:
            # Half of the usual size: both clouds are read at the same time.
            for chunk in cloud.chunks(CHUNK_POINTS // 2):
                yield StoredPoints(_relative(chunk.points, transform, lattice.offset), chunk.rows)
                if self.progress is not None and len(chunk.rows):
                    read[side] = int(chunk.rows[-1]) + 1
                    self.progress("reading the scans", sum(read.values()) / total)

        return each(placed, self.clouds, self.transforms, Pair(0, 1))


def tree_of(
    clouds: PlacedClouds, settings: BlockSettings = BlockSettings(), lattice: Lattice | None = None
) -> BlockTree:
    """The blocks of two clouds; they are read once, or, where their bounds are not declared rightly, up to three times.

    Args:
        clouds: both.
        settings: of the blocks.
        lattice: whose cells the blocks are to be, such as for voxels of a given grid; None: by the clouds' extent.

    Raises:
        InputError: a cloud has no points, all points are at one place, or some are outside of the given lattice.
    """
    if lattice is not None:
        try:
            return _counted(clouds, lattice, settings)
        except _BeyondBoundsError as error:
            raise InputError("lattice: points are outside of its cube; give a larger one") from error
    if all(own.bounds is not None for own in clouds.clouds):
        lattice = _lattice(clouds, clouds.clouds.map(lambda own: np.array(own.bounds, np.float64)))
        with contextlib.suppress(_BeyondBoundsError):
            return _counted(clouds, lattice, settings)
    chunks = clouds.clouds.map(lambda own: own.chunks(CHUNK_POINTS // 2))
    lattice = _lattice(clouds, read_both(_measured_bounds, chunks, _NAMES))
    if not 0 < lattice.edge < np.inf:
        raise InputError("before, after: all points are at one place; give scans of more than one point")
    return _counted(clouds, lattice, settings)


class _BeyondBoundsError(Exception):
    """Points are outside of the bounds that a file declares."""


_NAMES = Pair("before", "after")


def _counted(clouds: PlacedClouds, lattice: Lattice, settings: BlockSettings) -> BlockTree:
    def inside(chunks: Iterator[StoredPoints]) -> Iterator[Float64[np.ndarray, "n 3"]]:
        for chunk in chunks:
            if not (0 < lattice.edge < np.inf and lattice.holds(chunk.points)):
                raise _BeyondBoundsError
            yield chunk.points

    chunks = clouds.chunks(lattice).map(inside)
    tree = block_tree(count_cells(chunks, lattice, settings.cell_points), lattice, settings)
    for counts, name in zip(tree.counts, _NAMES, strict=True):
        if not counts.any():
            raise InputError(f"{name}: has no points; give a scan that has some")
    return tree


def _measured_bounds(chunks: Iterator[CloudChunk], name: str) -> Float64[np.ndarray, "2 3"]:
    boxes = [(chunk.points.min(axis=0), chunk.points.max(axis=0)) for chunk in chunks if len(chunk.points)]
    if not boxes:
        raise InputError(f"{name}: has no points; give a scan that has some")
    lowers, uppers = zip(*boxes, strict=True)
    return np.array([np.min(lowers, axis=0), np.max(uppers, axis=0)])


def _lattice(clouds: PlacedClouds, bounds: Pair[Float64[np.ndarray, "2 3"]]) -> Lattice:
    """A cube around the boxes of both clouds, with room for rounding."""

    def corners(box: Float64[np.ndarray, "2 3"], transform: Float64[np.ndarray, "4 4"] | None) -> np.ndarray:
        points = np.array(list(itertools.product(*box.T)))
        return points if transform is None else transformed(points, transform)

    points = np.concatenate(list(each(corners, bounds, clouds.transforms)))
    extent = float(np.ptp(points, axis=0).max())
    room = 0.0 if extent == 0 else max(1e-6 * extent, 1e-15 * float(np.abs(points).max()))
    return Lattice(points.min(axis=0) - room, extent + 4 * room)


def _relative(
    points: Float64[np.ndarray, "n 3"], transform: Float64[np.ndarray, "4 4"] | None, offset: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "n 3"]:
    """The points after a transform, relative to an offset."""
    if transform is None:
        return points - offset
    # Element by element: sums of products of arrays depend, in their last bit, on how many points there are.
    x, y, z = points.T
    columns = [
        ((own[0] * x + own[1] * y) + own[2] * z) + (own[3] - least)
        for own, least in zip(transform[:3], offset, strict=True)
    ]
    return np.stack(columns, axis=1)
