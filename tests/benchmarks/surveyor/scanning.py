"""What a scanner returns of a world: noise that grows with range and slant, mixed pixels, lost rays."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from tests.benchmarks.surveyor.solids import UNCHANGED, Thing, distances, first_hits
from tests.benchmarks.surveyor.terrain import Columns

# Rays that are cast at one time.
CHUNK = 200_000
# The index of the terrain, or of nothing, in place of a thing's.
TERRAIN, NOTHING = -2, -1


class Ground(Protocol):
    """A surface that is no thing: terrain, or the lining of a tunnel."""

    def ranges(self, columns: Columns) -> np.ndarray:
        """How far along each ray it is met [c, r]; inf where it is not."""

    def normals(self, places: np.ndarray) -> np.ndarray:
        """Unit normals at places [n, 3] on it."""

    def distances(self, places: np.ndarray) -> np.ndarray:
        """How far places [n, 3] are from it; NaN beyond its edges."""

    def sees(self, origin: np.ndarray, places: np.ndarray, slack: float) -> np.ndarray:
        """Which places [n, 3] it does not hide from one origin."""

    def nodes(self, places: np.ndarray) -> np.ndarray:
        """The nodes of its grid next to places [n, 3]."""


@dataclasses.dataclass(frozen=True, eq=False)
class World:
    """What stands there at one time.

    Attributes:
        things: on the terrain, or in the hall.
        terrain: or the lining of a tunnel; None: there is none.
    """

    things: Sequence[Thing]
    terrain: Ground | None = None

    def distances(self, places: np.ndarray, most: float) -> np.ndarray:
        """How far places [n, 3] are from the nearest solid surface; `most` where none is as near."""
        nearest = distances(self.things, places, most)
        if self.terrain is None:
            return nearest
        return np.fmin(nearest, self.terrain.distances(places))


@dataclasses.dataclass(frozen=True)
class Beam:
    """How a scanner measures ranges.

    Attributes:
        noise: standard deviation along the ray at short range and on a surface that faces it, metres.
        doubling: range over which the noise grows by as much again, metres.
        slanted: how much noise grows with the slant of the surface: by this times (1 / cosine - 1), threefold at most.
        mixed: share of the rays at depth edges that return something between the two surfaces.
        lost: share of all rays without a return.
        grazing: cosine below which a surface returns nothing.
        least_range: nothing nearer is returned, metres.
        max_range: nor anything further.
    """

    noise: float = 0.003
    doubling: float = 60.0
    slanted: float = 0.15
    mixed: float = 0.15
    lost: float = 0.01
    grazing: float = 0.04
    least_range: float = 0.6
    max_range: float = 300.0


class Scan(NamedTuple):
    """The points of one scan.

    Attributes:
        points: as measured [n, 3].
        places: where they are on the surfaces, without noise [n, 3].
        thing: the index of the thing, `TERRAIN` or `NOTHING`, of each.
        mixed: the index of the thing behind, where a point lies between two surfaces; else the same as `thing`.
    """

    points: np.ndarray
    places: np.ndarray
    thing: np.ndarray
    mixed: np.ndarray


def scanned(world: World, columns: Columns, beam: Beam, random: np.random.Generator) -> Scan:
    """One scan."""
    return Scan(*(np.concatenate(own) for own in zip(*scanned_parts(world, columns, beam, random), strict=True)))


def scanned_parts(world: World, columns: Columns, beam: Beam, random: np.random.Generator) -> Iterator[Scan]:
    """One scan, some hundred thousand rays at a time."""
    step = max(1, CHUNK // len(columns.elevations))
    # Where the scanner begins anew, columns that follow each other are no neighbours.
    starts = np.flatnonzero(np.abs(np.diff(columns.azimuths)) > 0.5) + 1
    for begin, end in itertools.pairwise([0, *starts.tolist(), len(columns.azimuths)]):
        for first in range(begin, end, step):
            yield _part(world, columns.part(slice(first, min(first + step, end))), beam, random)


def sees(
    world: World,
    origins: np.ndarray,
    places: np.ndarray,
    slack: float,
    random: np.random.Generator,
) -> np.ndarray:
    """Which places [n, 3] lie on what is seen from an origin [3], or from an origin each [n, 3], or before it."""
    visible = np.zeros(len(places), bool)
    for first in range(0, len(places), CHUNK):
        rows = slice(first, first + CHUNK)
        own = origins if origins.ndim == 1 else origins[rows]
        offset = places[rows] - own
        ranges = np.linalg.norm(offset, axis=1)
        hits = first_hits(world.things, own, offset / ranges[:, None], random)
        visible[rows] = hits.ranges > ranges - slack
    if world.terrain is not None and origins.ndim == 1:
        rows = np.flatnonzero(visible)
        visible[rows] = world.terrain.sees(origins, places[rows], slack)
    return visible


def _part(world: World, columns: Columns, beam: Beam, random: np.random.Generator) -> Scan:
    shape = (len(columns.azimuths), len(columns.elevations))
    directions = columns.directions().reshape(-1, 3)
    one_place = bool((columns.origins == columns.origins[0]).all())
    origins = columns.origins[0] if one_place else np.repeat(columns.origins, shape[1], axis=0)
    ranges, thing, facing = first_hits(world.things, origins, directions, random)
    if world.terrain is not None:
        own = world.terrain.ranges(columns).ravel()
        nearer = np.flatnonzero(own < ranges)
        ranges[nearer], thing[nearer] = own[nearer], TERRAIN
        met = (origins if one_place else origins[nearer]) + own[nearer, None] * directions[nearer]
        facing[nearer] = np.nan_to_num(np.abs((world.terrain.normals(met) * directions[nearer]).sum(axis=1)), nan=1.0)
    behind, other = _behind(ranges.reshape(shape), thing.reshape(shape))
    mixes = (behind > ranges) & np.isfinite(behind) & (random.random(len(ranges)) < beam.mixed)
    kept = np.isfinite(ranges) & (ranges > beam.least_range) & (random.random(len(ranges)) >= beam.lost)
    kept &= facing > beam.grazing * random.uniform(0.5, 1.5, len(ranges))
    rows = np.flatnonzero(kept)
    start = origins if one_place else origins[rows]
    true = ranges[rows]
    true = np.where(mixes[rows], true + random.random(len(rows)) * (behind[rows] - true), true)
    deviation = beam.noise * (1 + true / beam.doubling)
    deviation *= 1 + np.minimum(beam.slanted * (1 / np.maximum(facing[rows], 0.01) - 1), 2)
    measured = true + deviation * random.standard_normal(len(rows))
    reached = measured < beam.max_range
    rows, true, measured = rows[reached], true[reached], measured[reached]
    start = start if one_place else start[reached]
    return Scan(
        start + measured[:, None] * directions[rows],
        start + true[:, None] * directions[rows],
        thing[rows],
        np.where(mixes, other, thing)[rows],
    )


def _behind(ranges: np.ndarray, thing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The farthest of each ray's four neighbours that is behind a depth edge, and its thing; else its own."""
    far, other = ranges.copy(), thing.copy()
    with np.errstate(invalid="ignore"):
        for image, numbers, farthest, theirs in ((ranges, thing, far, other), (ranges.T, thing.T, far.T, other.T)):
            before, after = np.vstack([image[:1], image[:-1]]), np.vstack([image[1:], image[-1:]])
            # On a plane the inverse range is nearly linear from ray to ray, at an edge it is not.
            bend = np.abs(1 / before + 1 / after - 2 / image) * image
            neighbours = (
                (before, np.vstack([numbers[:1], numbers[:-1]])),
                (after, np.vstack([numbers[1:], numbers[-1:]])),
            )
            for neighbour, number in neighbours:
                edge = (
                    (bend > 0.02) & (neighbour > 1.01 * image + 0.03) & np.isfinite(neighbour) & (neighbour > farthest)
                )
                farthest[edge], theirs[edge] = neighbour[edge], number[edge]
    return far.ravel(), other.ravel()


def changes_of(world: World, thing: np.ndarray) -> np.ndarray:
    """The number of the change of things, by their indices; `UNCHANGED` for terrain and nothing."""
    numbers = np.array([own.change for own in world.things] + [UNCHANGED])
    return np.asarray(numbers[np.where(thing >= 0, thing, len(world.things))])
