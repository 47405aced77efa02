"""Figures 4.1 and 4.2: four and seven Gaussians, clustered with annihilation and by grid search (thesis 4.1)."""

import functools
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from gmmjax.changes import DetectionConfig, detect_changes
from gmmjax.mixtures import GaussianMixture, best_fit, fit_restarts, grid_search
from gmmjax.scenes import fixed_scene
from gmmjax.thesis.chapter4.records import Cell, Headline, Outcome, Plan, Table, Unit, Work

PART = "clustering"
# The clouds and the true number of their Gaussians.
CLOUDS: Mapping[str, int] = {"4 Gaussians": 4, "7 Gaussians": 7}
ANNIHILATION, GRID, CHANGES = "annihilation", "grid search", "changes"
RESTARTS, COMPONENTS = 8, range(3, 10)
ONE_START, BEST = "annihilation, one start", f"annihilation, best of {RESTARTS}"
# The thesis's results, in its words.
THESIS = {
    (ANNIHILATION, "4 Gaussians"): "right nearly every time",
    (ANNIHILATION, "7 Gaussians"): "right nearly every time",
    (GRID, "4 Gaussians"): "consistently right",
    (GRID, "7 Gaussians"): "not consistent: 6, 4",
}


def work(plan: Plan) -> Work:
    """Both clouds of each seed, clustered by both methods; of the first seed also the changes shown in figure 4.1."""
    units = []
    for seed in plan.seeds(plan.clustering_seeds):
        for cloud in CLOUDS:
            start = functools.partial(_annihilation, cloud, seed)
            units.append(Unit(PART, cloud, seed, ANNIHILATION, {"restarts": RESTARTS}, start))
            scan = functools.partial(_grid_search, cloud, seed)
            settings = {"components": list(COMPONENTS), "covariances": "diagonal", "criterion": "bic"}
            units.append(Unit(PART, cloud, seed, GRID, settings, scan))
    first = plan.first_seed
    change = functools.partial(_changes, first)
    return Work([*units, Unit(PART, "4 to 7 Gaussians", first, CHANGES, {"kinds": "appeared"}, change)])


def fixed_cloud(cloud: str, seed: int) -> Float[np.ndarray, "n 3"]:
    """One of the clouds: the fixed scene before, or after, with three more Gaussians.

    Args:
        cloud: a name in `CLOUDS`.
        seed: of the points.
    """
    scene = fixed_scene(jax.random.key(seed))
    return scene.before if CLOUDS[cloud] == 4 else scene.after


def tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """Figure 4.1 for annihilation, 4.2 for the grid search: numbers of Gaussians found, and how many are correct."""
    annihilation = [
        row
        for cloud in CLOUDS
        for row in (
            _row(ONE_START, cloud, [found for own in _of(outcomes, ANNIHILATION, cloud) for found in own["found"]]),
            _row(BEST, cloud, [own["best"] for own in _of(outcomes, ANNIHILATION, cloud)]),
        )
    ]
    grid = [_row(GRID, cloud, [own["best"] for own in _of(outcomes, GRID, cloud)]) for cloud in CLOUDS]
    return [
        Table("4.1", "clustering with annihilation", tuple(annihilation)),
        Table("4.2", "clustering by grid search", tuple(grid)),
    ]


def headlines(outcomes: Sequence[Outcome]) -> list[Headline]:
    """How often each method finds the correct number."""
    annihilation, grid = tables(outcomes)
    return [
        Headline(
            table.figure,
            f"number of Gaussians right, {row['cloud']}",
            str(row["method"]),
            f"{row['right']} of {row['fits']}",
            THESIS[method, str(row["cloud"])],
        )
        for table, method in ((annihilation, ANNIHILATION), (grid, GRID))
        for row in table.rows
    ]


def mixture_of(result: Mapping[str, Any]) -> GaussianMixture:
    """The mixture in a unit's result."""
    weights, means, covariances = (np.array(result["mixture"][name]) for name in ("weights", "means", "covariances"))
    return GaussianMixture(weights, means, covariances, np.ones(len(weights), bool))


def _of(outcomes: Sequence[Outcome], method: str, cloud: str) -> list[Mapping[str, Any]]:
    return [outcome.result for outcome in outcomes if (outcome.method, outcome.condition) == (method, cloud)]


def _row(method: str, cloud: str, found: Sequence[int]) -> dict[str, Cell]:
    right = sum(number == CLOUDS[cloud] for number in found)
    return {
        "cloud": cloud,
        "method": method,
        "fits": len(found),
        "right": right,
        "share": round(right / len(found), 4) if found else None,
        "found": ", ".join(f"{number}: {times}" for number, times in sorted(Counter(found).items())),
    }


def _annihilation(cloud: str, seed: int) -> dict[str, Any]:
    fits = fit_restarts(fixed_cloud(cloud, seed), key=jax.random.key(seed), restarts=RESTARTS)
    best = best_fit(fits, throw=True)
    return {
        "found": fits.mixture.live.sum(axis=1).tolist(),
        "best": int(best.mixture.live.sum()),
        "mixture": _plain(best.mixture),
    }


def _grid_search(cloud: str, seed: int) -> dict[str, Any]:
    search = grid_search(
        fixed_cloud(cloud, seed),
        key=jax.random.key(seed),
        components=COMPONENTS,
        covariance_types=("diagonal",),
        criterion="bic",
    )
    return {"best": int(search.fit.mixture.live.sum()), "mixture": _plain(search.fit.mixture)}


def _changes(seed: int) -> dict[str, Any]:
    """The Gaussians that appeared according to the published algorithm."""
    config = DetectionConfig(method="greedy", kinds="appeared", restarts=1)
    clouds = (fixed_cloud(cloud, seed) for cloud in CLOUDS)
    items = detect_changes(*clouds, config=config).items
    return {
        "mixture": {
            "weights": [1 / len(items)] * len(items),
            "means": [item.mean.tolist() for item in items],
            "covariances": [item.covariance.tolist() for item in items],
        }
    }


def _plain(mixture: GaussianMixture) -> dict[str, Any]:
    live = mixture.live_part()
    return {name: np.asarray(getattr(live, name)).tolist() for name in ("weights", "means", "covariances")}
