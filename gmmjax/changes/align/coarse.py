"""Rigid transforms that may register two scans, whatever their displacement.

The rotation and the translation are found one after the other (Makadia, Patterson and Daniilidis 2006): rotations from
the distributions of the normals, which no translation changes, and for each rotation the translations from the
cross-correlation of the two clouds on a voxel grid, which the fast Fourier transform gives for all of them at once.
"""

import dataclasses
import functools
from typing import NamedTuple

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Int
from scipy.spatial.transform import Rotation

from gmmjax.geometry import LocalSurface, rotation_about
from gmmjax.pair import Pair

# Between the rotations that are compared, degrees: about half of what the voxels blur.
ROTATION_STEP = 7.0


class CoarseTransforms(NamedTuple):
    """Transforms of the after cloud, the one with the highest correlation first.

    Attributes:
        transforms: rigid transforms [4, 4].
        accuracy: edge of the voxels, in the unit of the clouds: points are this far from where they belong.
    """

    transforms: list[Float[np.ndarray, "4 4"]]
    accuracy: float


def coarse_transforms(surfaces: Pair[LocalSurface]) -> CoarseTransforms:
    """The six transforms of the after cloud by which both clouds correlate most, of rotations up to 35 degrees.

    Args:
        surfaces: of both clouds.
    """
    own, other = (_sampled(surface, 5_000, seed) for seed, surface in enumerate(surfaces))
    grid = _Grid.around(own[0], other[0])
    spectrum = grid.spectrum(own[0] - grid.before, own[1])
    found: list[tuple[float, Float[np.ndarray, "4 4"]]] = []
    for rotation in _rotations(own[1][:500], other[1][:500]):
        # Not by BLAS, whose threads cost more than such products.
        points, normals = (np.einsum("ij,nj->ni", rotation, rows) for rows in (other[0] - grid.after, other[1]))
        rotated = grid.spectrum(points, normals)
        for score, translation in grid.translations(spectrum, rotated, 3):
            found.append((score, rotation_about(rotation, grid.after, grid.before + translation)))
    found.sort(key=lambda hypothesis: -hypothesis[0])
    return CoarseTransforms([transform for _, transform in found[:6]], grid.edge)


def _sampled(surface: LocalSurface, size: int, seed: int) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Centres and normals of some of the points, in random order."""
    chosen = np.random.default_rng(seed).permutation(len(surface))[:size]
    return surface.centres[chosen], surface.normals[chosen]


def normal_space_sample(
    surface: LocalSurface, size: int, *, pool: int = 6_000, kernel: float = 15.0, floor: float = 0.02
) -> Int[np.ndarray, " m"]:
    """Points whose normals have all directions alike (Rusinkiewicz and Levoy 2001): few see in what a floor slides.

    Args:
        surface: that the points are of.
        size: number of points, at most.
        pool: points that they are drawn from.
        kernel: width within which directions are the same, degrees.
        floor: density of directions below which a point is not drawn more often: such normals are often noise. 1: all
            points are alike.
    """
    random = np.random.default_rng(0)
    chosen = random.permutation(len(surface))[:pool]
    normals = surface.normals[chosen]
    weights = 1 / (_DirectionDensity.of(normals[:500], np.radians(kernel), 12)(normals) + floor)
    return chosen[random.choice(len(chosen), min(size, len(chosen)), replace=False, p=weights / weights.sum())]


# --- rotations -------------------------------------------------------------------------------------------------------


def _rotations(before: Float[np.ndarray, "n 3"], after: Float[np.ndarray, "m 3"]) -> list[Float[np.ndarray, "3 3"]]:
    """The identity, and the nine rotations that bring most of the after normals to normals of the before cloud."""
    candidates = _rotations_within(35.0, ROTATION_STEP)
    density = _DirectionDensity.of(before, np.radians(8.0))
    scores = density(np.einsum("rij,nj->rni", candidates, after)).mean(axis=1)
    # The first candidate is the identity.
    kept = [0]
    min_angle = np.radians(1.5 * ROTATION_STEP)
    for index in np.argsort(-scores, kind="stable"):
        if len(kept) > 9:
            break
        traces = np.einsum("rij,ij->r", candidates[kept], candidates[index])
        if np.arccos(np.clip((traces - 1) / 2, -1, 1)).min() > min_angle:
            kept.append(int(index))
    return [candidates[index] for index in kept]


@functools.cache
def _rotations_within(largest: float, step: float) -> Float[np.ndarray, "r 3 3"]:
    """Rotation matrices on a lattice of rotation vectors, the least rotation first; angles in degrees."""
    axis = np.arange(-(largest // step), largest // step + 1) * np.radians(step)
    vectors = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    angles = np.linalg.norm(vectors, axis=1)
    nearest_first = np.argsort(angles, kind="stable")
    return Rotation.from_rotvec(vectors[nearest_first[: (angles <= np.radians(largest) + 1e-9).sum()]]).as_matrix()


@dataclasses.dataclass(frozen=True, eq=False)
class _DirectionDensity:
    """The density of unoriented directions, in a table over the cube around the unit sphere."""

    table: Float[np.ndarray, " cells"]
    size: int

    @classmethod
    def of(cls, directions: Float[np.ndarray, "n 3"], kernel: float, size: int = 24) -> "_DirectionDensity":
        """The density of these directions; the kernel's width is in radians."""
        middle = (np.indices((size, size, size)).reshape(3, -1).T + 0.5) / size * 2 - 1
        radius = np.linalg.norm(middle, axis=1)
        # Cells that the sphere does not pass through are never looked up.
        shell = np.abs(radius - 1) <= np.sqrt(3) / size
        cosines = np.einsum("ci,di->cd", middle[shell] / radius[shell, None], directions)
        table = np.zeros(size**3)
        table[shell] = np.exp((cosines**2 - 1) / (2 * kernel**2)).mean(axis=1)
        return cls(table, size)

    def __call__(self, directions: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "..."]:
        """The density at unit vectors."""
        cell = np.minimum(((directions + 1) * (self.size / 2)).astype(int), self.size - 1)
        return self.table[(cell[..., 0] * self.size + cell[..., 1]) * self.size + cell[..., 2]]


# --- translations ----------------------------------------------------------------------------------------------------

# The six entries of a symmetric matrix; those off the diagonal stand for two.
ROWS, COLUMNS = np.array([0, 1, 2, 0, 1, 0]), np.array([0, 1, 2, 1, 2, 2])
FACTORS = np.where(ROWS == COLUMNS, 1.0, np.sqrt(2))[:, None]


@dataclasses.dataclass(frozen=True, eq=False)
class _Grid:
    """A periodic voxel grid on which two clouds are correlated.

    Attributes:
        before: median of the before cloud, the middle of the grid.
        after: median of the after cloud, which is laid there.
        edge: of a voxel.
        shape: number of voxels along each axis.
    """

    before: Float[np.ndarray, "3"]
    after: Float[np.ndarray, "3"]
    edge: float
    shape: Int[np.ndarray, "3"]

    @classmethod
    def around(cls, before: Float[np.ndarray, "n 3"], after: Float[np.ndarray, "m 3"]) -> "_Grid":
        """A grid that holds the before cloud, 20 voxels long, and the after cloud in any rotation about its place.

        At most 54 voxels a side bound memory and time.
        """
        middles = np.median(before, axis=0), np.median(after, axis=0)
        lower, upper = np.percentile(before, (1, 99), axis=0)
        half = np.maximum(upper - middles[0], middles[0] - lower)
        reach = float(np.percentile(np.linalg.norm(after - middles[1], axis=1), 98))
        edge = max(float((upper - lower).max()) / 20, float(np.finfo(np.float64).tiny))
        # Of a flat cloud what the other one needs beside it when it is rotated, no more.
        sides = 2 * (half + np.minimum(reach, 2 * half + 0.3 * half.max())) / edge
        shape = [scipy.fft.next_fast_len(int(np.ceil(min(side, 54)))) for side in sides]
        return cls(*middles, edge, np.minimum(np.maximum(shape, 4), 54))

    def spectrum(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Complex[np.ndarray, "6 a b c"]:
        """The Fourier transform of the mean outer product of the normals in each voxel; points about the middle.

        The product of two such matrices is the mean squared cosine between the normals of two voxels: walls agree with
        walls, and a voxel with many points counts as much as one with few.
        """
        cells = np.floor(points / self.edge + self.shape / 2).astype(int)
        inside = ((cells >= 0) & (cells < self.shape)).all(axis=1)
        flat = np.ravel_multi_index(tuple(cells[inside].T), tuple(self.shape))
        products = FACTORS * (normals[inside][:, ROWS] * normals[inside][:, COLUMNS]).T
        size = int(self.shape.prod())
        sums = np.array([np.bincount(flat, values, size) for values in products], np.float32)
        means = sums / np.maximum(np.bincount(flat, minlength=size), 1).astype(np.float32)
        return np.asarray(scipy.fft.rfftn(means.reshape(6, *self.shape), axes=(1, 2, 3)))

    def translations(
        self, before: Complex[np.ndarray, "6 a b c"], after: Complex[np.ndarray, "6 a b c"], count: int
    ) -> list[tuple[float, Float[np.ndarray, "3"]]]:
        """The translations of the after cloud with the highest correlation, with that correlation."""
        correlation = scipy.fft.irfftn((before * after.conj()).sum(axis=0), tuple(self.shape))
        found = []
        for _ in range(count):
            peak = np.array(np.unravel_index(np.argmax(correlation), correlation.shape))
            found.append((float(correlation[tuple(peak)]), (peak - self.shape * (peak > self.shape // 2)) * self.edge))
            beside = [np.arange(place - 2, place + 3) % side for place, side in zip(peak, self.shape, strict=True)]
            correlation[np.ix_(*beside)] = -np.inf
        return found
