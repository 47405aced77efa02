"""Figures 4.1 and 4.2: four and seven Gaussians, clustered with annihilation and by grid search (thesis 4.1)."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from gmmjax.changes import DetectionConfig, detect_changes
from gmmjax.mixtures import GaussianMixture, best_fit, fit_restarts, grid_search
from gmmjax.scenes import fixed_scene
from gmmjax.thesis.chapter4 import figures
from gmmjax.thesis.chapter4.accuracy import Progress
from gmmjax.thesis.chapter4.table import Cell, Part, Table

# The clouds and the true number of their Gaussians.
CLOUDS: Mapping[str, int] = {"4 Gaussians": 4, "7 Gaussians": 7}
# Starts of a fit with annihilation.
RESTARTS = 8
ONE_START, BEST, GRID = "annihilation, one start", f"annihilation, best of {RESTARTS}", "grid search"


class Clustered(NamedTuple):
    """A cloud with its mixture, and the numbers of Gaussians that the starts of its fit found."""

    points: Float[np.ndarray, "n 3"]
    mixture: GaussianMixture
    found: list[int]

    @property
    def gaussians(self) -> int:
        """The number of Gaussians."""
        return int(self.mixture.live.sum())


def clustering(seeds: Sequence[int], progress: Progress) -> Part:
    """Figures 4.1 and 4.2: the numbers of Gaussians that annihilation and the grid search find."""
    fits: dict[str, list[Clustered]] = {cloud: [] for cloud in CLOUDS}
    searches: dict[str, list[Clustered]] = {cloud: [] for cloud in CLOUDS}
    for number, seed in enumerate(seeds):
        progress(f"clustering, seed {seed}", number / len(seeds))
        for cloud in CLOUDS:
            fits[cloud].append(_fit(fixed_cloud(cloud, seed), seed))
            searches[cloud].append(_search(fixed_cloud(cloud, seed), seed))
    found = {
        ONE_START: {cloud: [count for fit in own for count in fit.found] for cloud, own in fits.items()},
        BEST: {cloud: [fit.gaussians for fit in own] for cloud, own in fits.items()},
        GRID: {cloud: [search.gaussians for search in own] for cloud, own in searches.items()},
    }
    by_fit = [number_row(method, cloud, found[method][cloud]) for cloud in CLOUDS for method in (ONE_START, BEST)]
    by_search = [number_row(GRID, cloud, found[GRID][cloud]) for cloud in CLOUDS]
    drawn = {cloud: own[0] for cloud, own in fits.items()}
    drawn["appeared"] = drawn["7 Gaussians"]._replace(mixture=_appeared(seeds[0]))
    wrong = [search for search in searches["7 Gaussians"][1:] if search.gaussians != 7]
    searched = {cloud: own[0] for cloud, own in searches.items()} | dict(zip(["another seed"], wrong, strict=False))
    every = "each number, with the same results nearly every time, and the three Gaussians that appeared."
    four = "consistently four, but not seven: 6, 4."
    return Part(
        [
            Table("4.1", "clustering with annihilation", every, by_fit, by_fit, figures.clusters(drawn)),
            Table("4.2", "clustering by grid search", four, by_search, by_search, figures.searches(searched, found)),
        ]
    )


def fixed_cloud(cloud: str, seed: int) -> Float[np.ndarray, "n 3"]:
    """The fixed scene before, or after, with three more Gaussians; the seed is that of the points."""
    scene = fixed_scene(jax.random.key(seed))
    return scene.before if CLOUDS[cloud] == 4 else scene.after


def number_row(method: str, cloud: str, found: Sequence[int]) -> dict[str, Cell]:
    """Row of the table for one method: how many of its fits find the true number of Gaussians."""
    right = sum(number == CLOUDS[cloud] for number in found)
    counts = ", ".join(f"{number}: {times}" for number, times in sorted(Counter(found).items()))
    share = round(right / len(found), 4)
    return {"cloud": cloud, "method": method, "fits": len(found), "right": right, "share": share, "found": counts}


def _fit(points: Float[np.ndarray, "n 3"], seed: int) -> Clustered:
    fits = fit_restarts(points, key=jax.random.key(seed), restarts=RESTARTS)
    return Clustered(points, best_fit(fits, throw=True).mixture, fits.mixture.live.sum(axis=1).tolist())


def _search(points: Float[np.ndarray, "n 3"], seed: int) -> Clustered:
    key, components = jax.random.key(seed), range(3, 10)
    search = grid_search(points, key=key, components=components, covariance_types=("diagonal",), criterion="bic")
    return Clustered(points, search.fit.mixture, [])


def _appeared(seed: int) -> GaussianMixture:
    """The Gaussians that appeared according to the published algorithm."""
    config = DetectionConfig(method="greedy", kinds="appeared", restarts=1)
    items = detect_changes(*(fixed_cloud(cloud, seed) for cloud in CLOUDS), config=config).items
    means, covariances = (np.stack([getattr(item, name) for item in items]) for name in ("mean", "covariance"))
    return GaussianMixture(np.full(len(items), 1 / len(items)), means, covariances, np.ones(len(items), bool))
