"""What surveyors use, at its best for these scenes: cloud-to-cloud distances and M3C2 with its level of detection."""

import itertools
import logging
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from gmmjax.clouds import voxel_grid
from gmmjax.evaluation.peers import has_m3c2
from gmmjax.geometry import density_clusters
from gmmjax.pair import Pair, each
from tests.benchmarks.surveyor.surveys import SurveyedPair

# Points of a change, at least, at the resolution that a peer works at.
SMALLEST = 10
# Registration error that M3C2 is told, metres: about what the scenes have.
REGISTRATION = 0.004
# Edges of the voxels that the clouds are reduced to, metres, by the kind's scale.
VOXELS: Mapping[str, tuple[float, ...]] = {
    "hall": (0.04, 0.08),
    "warehouse": (0.04, 0.08),
    "slope": (0.15, 0.3),
    "quarry": (0.15, 0.3),
}


class Setting(NamedTuple):
    """A peer with what is set."""

    name: str
    text: str


def peer_labels(kind: str, pair: SurveyedPair) -> Iterator[tuple[Setting, Pair[np.ndarray]]]:
    """The labels that every setting of every peer gives."""
    for voxel in VOXELS[kind]:
        origin = pair.points.before.min(axis=0)
        grids = pair.points.map(lambda points, voxel=voxel, origin=origin: voxel_grid(points - origin, voxel))
        points = grids.map(lambda grid: grid.points)
        for setting, differs in itertools.chain(_cloud_to_cloud(points, voxel), _m3c2(points, voxel)):
            labels = each(lambda own, rows, voxel=voxel: _clusters(own, rows, voxel), points, differs)
            yield setting, each(lambda own, grid: own[grid.voxel_of_point], labels, grids)


def _cloud_to_cloud(points: Pair[np.ndarray], voxel: float) -> Iterator[tuple[Setting, Pair[np.ndarray]]]:
    far = each(lambda own, other: cKDTree(other).query(own)[0], points, points.swapped)
    for distance in (1.0, 1.5, 2.0, 3.0, 5.0):
        text = f"voxels {voxel:g} m, distance {distance * voxel:.2g} m"
        yield Setting("c2c", text), far.map(lambda own, least=distance * voxel: own > least)


def _m3c2(points: Pair[np.ndarray], voxel: float) -> Iterator[tuple[Setting, Pair[np.ndarray]]]:
    if not has_m3c2():
        return
    for radius in (1.5, 3.0):
        found = each(lambda own, other, radius=radius * voxel: _distances(own, other, radius), points, points.swapped)
        for deepest, lonely in itertools.product((1.0, 2.0), (True, False)):
            text = f"voxels {voxel:g} m, radius {radius * voxel:.2g} m, {deepest:g} LoD"
            text += ", points without a partner changed" if lonely else ""

            def differs(own: tuple[np.ndarray, np.ndarray], times: float = deepest, alone: bool = lonely) -> np.ndarray:
                distance, detectable = own
                return np.where(np.isnan(distance), alone, np.abs(distance) > times * detectable)

            yield Setting("m3c2", text), found.map(differs)


def _distances(own: np.ndarray, other: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    import py4dgeo

    # It logs to standard output and to a file in the working directory.
    logging.getLogger("py4dgeo").setLevel(logging.ERROR)
    algorithm = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(own), py4dgeo.Epoch(other)),
        corepoints=own,
        cyl_radius=radius,
        normal_radii=(1.5 * radius,),
        max_distance=8 * radius,
        registration_error=REGISTRATION,
    )
    distances, uncertainties = algorithm.run()
    return distances, uncertainties["lodetection"]


def _clusters(points: np.ndarray, differs: np.ndarray, voxel: float) -> np.ndarray:
    labels = np.full(len(points), -1)
    labels[differs] = density_clusters(points[differs], 2.5 * voxel, 4)
    counts = np.bincount(labels[labels >= 0], minlength=1)
    kept = np.flatnonzero(counts >= SMALLEST)
    return np.where(np.isin(labels, kept), np.searchsorted(kept, labels), -1)
