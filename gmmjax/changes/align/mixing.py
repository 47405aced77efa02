"""A test that two clouds are samples of one density: the nearest neighbour test (Schilling 1986)."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gmmjax.changes.align.confidence import ConfidenceModel
from gmmjax.changes.align.surface_fit import random_sample
from gmmjax.clouds import first_of_equals
from gmmjax.geometry import evenly_chosen, nearest_neighbours, rotation_about, transformed
from gmmjax.pair import Pair, each


class _Side(NamedTuple):
    tree: cKDTree
    sample: Float64[np.ndarray, "m 3"]
    distances: Float64[np.ndarray, " m"]


@dataclasses.dataclass(frozen=True)
class Mixing:
    """Two clouds, and how far the points of a sample of each are from the next point of their own cloud."""

    sides: Pair[_Side]

    @classmethod
    def of(cls, points: Pair[Float64[np.ndarray, "_ 3"]]) -> "Mixing":
        """The mixing of two clouds; equal points that follow each other count once.

        Args:
            points: of both clouds.
        """
        return cls(points.map(_side))

    def mixed(self, transform: Float64[np.ndarray, "4 4"]) -> Pair[Float64[np.ndarray, " _"]]:
        """For each point of the samples 1 where the next point is one of the other cloud, 1/2 where both are as near.

        Args:
            transform: of the after cloud [4, 4].
        """
        before, after = self.sides
        places = Pair(transformed(before.sample, np.linalg.inv(transform)), transformed(after.sample, transform))
        return each(_nearer, self.sides, self.sides.swapped, places)

    def share(self, transform: Float64[np.ndarray, "4 4"]) -> float:
        """Share of the points that are mixed as in two samples of one density, in the cloud where it is less: 0 to 1.

        Args:
            transform: of the after cloud [4, 4].
        """
        counts = self.sides.map(lambda side: side.tree.n)
        expected = Pair(counts.after, counts.before).map(lambda other: other / max(sum(counts) - 1, 1))
        shares = each(lambda mixed, own: float(mixed.mean()) / own, self.mixed(transform), expected)
        return min(*shares, 1.0)

    def better(self, transform: Float64[np.ndarray, "4 4"], than: Float64[np.ndarray, "4 4"]) -> float:
        """Standard deviations by which more points are mixed by one transform than by another (McNemar 1947).

        Args:
            transform: of the after cloud [4, 4].
            than: the other one.
        """
        rise = np.concatenate([*self.mixed(transform)]) - np.concatenate([*self.mixed(than)])
        return float(rise.sum() / max(np.abs(rise).sum(), 1.0) ** 0.5)

    def confidence(self) -> float:
        """The probability that the given frame is right; 0 where a small motion of the after cloud mixes better."""
        share = self.share(np.eye(4))
        # Four standard deviations: the best of many motions is looked at.
        if any(self.better(motion, np.eye(4)) > 4 for motion in self._small_motions()):
            return 0.0
        return ConfidenceModel().of_mixing(share)

    def _small_motions(self) -> list[Float64[np.ndarray, "4 4"]]:
        points = self.sides.after.sample
        centre, spacing = points.mean(axis=0), float(np.median(self.sides.after.distances))
        size = max(float(np.sqrt(points.var(axis=0).sum())), np.finfo(np.float64).tiny)
        motions = []
        for spacings in (1, 4, 16):
            for direction in spacings * spacing * np.concatenate([np.eye(3), -np.eye(3)]):
                motions.append(rotation_about(np.eye(3), centre, centre + direction))
                motions.append(rotation_about(Rotation.from_rotvec(direction / size).as_matrix(), centre, centre))
        return motions


def _side(cloud: Float64[np.ndarray, "n 3"]) -> _Side:
    cloud = cloud[first_of_equals(cloud)]
    cloud = cloud[evenly_chosen(len(cloud), 50_000)]
    tree, sample = cKDTree(cloud), cloud[random_sample(len(cloud), 3_000)]
    return _Side(tree, sample, nearest_neighbours(tree, sample, 2)[0][:, -1])


def _nearer(own: _Side, other: _Side, places: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, " m"]:
    distances = nearest_neighbours(other.tree, places, 1)[0][:, 0]
    return np.asarray((np.sign(own.distances - distances) + 1) / 2)
