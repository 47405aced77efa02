"""Two clouds of any size in one frame, both read in chunks at the same time."""

import dataclasses
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float64, UInt64

from gmmjax._cores import available_cores
from gmmjax.clouds import CHUNK_POINTS, ChunkedCloud, CloudChunk, morton_codes
from gmmjax.errors import InputError
from gmmjax.pair import Pair, each

Read = TypeVar("Read")
Made = TypeVar("Made")


@dataclasses.dataclass(frozen=True, eq=False)
class Lattice:
    """A cube, and its cells: those of a level have half the edge of those of the level before.

    Attributes:
        offset: lowest corner of the cube, in the frame of the clouds. All coordinates below are relative to it.
        edge: of the cube, the only cell of level 0.
    """

    offset: Float64[np.ndarray, "3"]
    edge: float

    def edge_of(self, level: int) -> float:
        """The edge of the cells of a level."""
        return float(self.edge / 2**level)

    def holds(self, points: Float64[np.ndarray, "n 3"]) -> bool:
        """True where all points, relative to the offset, are in the cube."""
        return bool(points.min(initial=0.0) >= 0 and points.max(initial=0.0) < self.edge)

    def codes(self, points: Float64[np.ndarray, "n 3"], level: int) -> UInt64[np.ndarray, " n"]:
        """The Morton code of the cell of each point.

        Args:
            points: in the cube, relative to the offset.
            level: of the cells, at most 21.
        """
        # Scaled by powers of two, so that the cells of a level are exactly eight of the next.
        return morton_codes((points.T * (2**level / self.edge)).astype(np.uint64))


@dataclasses.dataclass(frozen=True, eq=False)
class PlacedClouds:
    """Two clouds and where they lie.

    Attributes:
        clouds: both, each in a frame of its own.
        lattice: holds both, in the frame of the before cloud.
        transform: rigid transform that takes the after cloud into the frame of the before cloud; None: it is in it.
    """

    clouds: Pair[ChunkedCloud]
    lattice: Lattice
    transform: Float64[np.ndarray, "4 4"] | None = None

    @property
    def row_counts(self) -> Pair[int]:
        """The number of rows of either cloud, those without a position among them."""
        return self.clouds.map(lambda own: own.count)

    def chunks(self) -> Pair[Iterator[CloudChunk]]:
        """The points of either cloud relative to the lattice's offset, some at a time.

        Raises:
            InputError: while they are read: a file cannot be read, or has points outside of the lattice.
        """
        return each(self._placed, self.clouds, Pair(None, self.transform))

    def _placed(self, cloud: ChunkedCloud, transform: Float64[np.ndarray, "4 4"] | None) -> Iterator[CloudChunk]:
        # Half of the usual size: both clouds are read at the same time.
        for points, rows in cloud.chunks(CHUNK_POINTS // 2):
            placed = _relative(points, transform, self.lattice.offset)
            if not self.lattice.holds(placed):
                raise file_changed()
            yield CloudChunk(placed, rows)


def file_changed() -> InputError:
    """The error for a file that has other points than before."""
    return InputError("before, after: a file changed while it was read; start again when it is complete")


def read_both(function: Callable[..., Made], chunks: Pair[Iterable[Read]], *pairs: Pair[Any]) -> Pair[Made]:
    """The function's value for either cloud, both at the same time where there are two cores.

    Where one fails, or at Ctrl-C, the other one ends with its next chunk.

    Args:
        function: of the chunks of a cloud, and of that cloud's own of all other pairs; it releases Python's lock.
        chunks: of both clouds.
        pairs: further arguments.
    """
    if available_cores() < 2:
        return each(function, chunks, *pairs)
    stop = threading.Event()
    with ThreadPoolExecutor(2) as threads:
        futures = each(lambda own, *others: threads.submit(function, _until(stop, own), *others), chunks, *pairs)
        try:
            done = wait(list(futures), return_when=FIRST_EXCEPTION).done
            for future in futures:
                if future in done:
                    future.result()
        finally:
            stop.set()
    return futures.map(lambda future: future.result())


class _StoppedError(Exception):
    """The other cloud could not be read."""


def _until(stop: threading.Event, chunks: Iterable[Read]) -> Iterator[Read]:
    for chunk in chunks:
        if stop.is_set():
            raise _StoppedError
        yield chunk


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
