"""Manifests of simulated pairs for the benchmarks of batch runs, with the pairs as PLY files."""

import csv
import math
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np

from gmmjax.clouds import write_ply
from gmmjax.evaluation import family_sources
from gmmjax.pair import Pair
from gmmjax.scenes import random_scene
from tests.benchmarks.memory_of_detections import LARGEST, SMALLEST
from tests.benchmarks.scenes import changed_pair, hall_pair

Clouds = Pair[np.ndarray]
MANIFEST = "manifest.csv"
GAUSSIANS, POINTS_OF_GAUSSIANS = 5, 5_000
FAMILIES, POINTS_OF_SCANS = ("rooms", "tabletop", "halls"), 20_000


def gaussians(seed: int) -> Clouds:
    """2 x 5,000 points of five Gaussians, of which one goes and another comes."""
    points = POINTS_OF_GAUSSIANS // GAUSSIANS
    scene = random_scene(jax.random.key(seed), start=GAUSSIANS, appeared=1, disappeared=1, points=points)
    return Pair(scene.before, scene.after)


def rooms(seed: int) -> Clouds:
    """Scans of a room, a table or a hall, in turn; 20,000 points a cloud or what there is, without poses."""
    family = FAMILIES[seed % len(FAMILIES)]
    pair = family_sources([family], [seed], poses="unknown")[0].load()
    random = np.random.default_rng(seed)

    def thinned(points: np.ndarray) -> np.ndarray:
        kept = random.permutation(len(points))[:POINTS_OF_SCANS]
        return points[np.sort(kept)]

    return Pair(pair.before.points, pair.after.points).map(thinned)


def changing(seed: int) -> Clouds:
    """Scans and volumes in turn, each cloud of its own size, uniform in the logarithm, as `memory_of_detections`."""
    sizes = np.exp(np.random.default_rng(seed).uniform(math.log(SMALLEST), math.log(LARGEST), 2)).astype(int).tolist()
    scene = (hall_pair, changed_pair)[seed % 2]
    return Pair(*scene(sizes[0], seed, sizes[1]))


KINDS: dict[str, Callable[[int], Clouds]] = {"gaussians": gaussians, "rooms": rooms, "changing": changing}


def write_pairs(folder: Path, kind: str, count: int) -> Path:
    """Writes the pairs that are not there yet, and the manifest; returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for seed in range(count):
        name = f"{kind}-{seed:04}"
        files = Pair("before", "after").map(lambda time, name=name: folder / f"{name}-{time}.ply")
        if not all(file.exists() for file in files):
            for file, cloud in zip(files, KINDS[kind](seed), strict=True):
                write_ply(file, cloud)
        rows.append([name, *(file.name for file in files)])
    write_manifest(folder / MANIFEST, rows)
    return folder / MANIFEST


def write_manifest(path: Path, rows: list[list[str]]) -> None:
    """Name, before and after of each pair."""
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([("name", "before", "after"), *rows])


def read_manifest(path: Path) -> list[list[str]]:
    """Name, before and after of each pair, with the files' whole paths."""
    with path.open(newline="") as file:
        rows = [[row["name"], row["before"], row["after"]] for row in csv.DictReader(file)]
    return [[name, *(str((path.parent / own).resolve()) for own in files)] for name, *files in rows]
