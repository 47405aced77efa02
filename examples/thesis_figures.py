"""The figures of the thesis's method and results, on scenes that are simulated here, in one picture.

In the first row scenes of Gaussians and what changed (figures 3.2 and 4.1), in the second one the flow of mass between
the mixtures (2.1) and the search for the number of Gaussians (3.9), in the third one the scores by condition (4.9).
"""

import argparse
from pathlib import Path

import jax
import numpy as np

from gmmjax import GaussianMixture, detect_changes, earth_movers_distance
from gmmjax.evaluation import Evaluation, ReliabilityRecord, detector, evaluate, gaussian_sources
from gmmjax.mixtures import Fit, GridSearch, best_fit, fit_restarts, grid_search
from gmmjax.scenes import GaussianScene, fixed_scene


def scored(names: list[str], seeds: int) -> tuple[Evaluation, ReliabilityRecord]:
    """The scores of some detectors on the scenes of figure 4.9 with little overlap, and their probabilities."""
    record = ReliabilityRecord()
    sources = [source for source in gaussian_sources(range(seeds)) if source.condition.endswith("low")]
    return evaluate({name: detector(name) for name in names}, sources, record=record.add), record


def draw(
    path: Path,
    scene: GaussianScene,
    mixtures: list[GaussianMixture],
    searches: tuple[GridSearch, Fit],
    scores: tuple[Evaluation, ReliabilityRecord],
) -> None:
    """All figures as one."""
    from matplotlib.figure import Figure

    from gmmjax import plotting

    figure = Figure(figsize=(15, 15.5), layout="constrained")
    rows = figure.subfigures(3, 1, height_ratios=[1.25, 1, 0.95])
    axes = np.array([row.subplots(1, 3) for row in rows[:2]])
    for ax, name, points, mixture in zip(
        axes[0], ("Before", "After"), (scene.before, scene.after), mixtures, strict=False
    ):
        plotting.plot_mixture(mixture, points, unit="m", ax=ax)
        ax.set_title(f"{name}: {int(mixture.count)} Gaussians")
    plotting.plot_changes(detect_changes(scene.before, scene.after), direction="oblique", ax=axes[0, 2])
    axes[0, 2].set_title("Changes")
    plotting.plot_transport(*mixtures, earth_movers_distance(*mixtures), unit="m", ax=axes[1, 0])
    plotting.plot_grid_search(searches[0], ax=axes[1, 1])
    axes[1, 1].set_title("Grid search, after")
    plotting.plot_message_length(searches[1], ax=axes[1, 2])
    axes[1, 2].set_title("Annihilation from 16 starts, after")
    bars, curve = rows[2].subplots(1, 2, width_ratios=[2, 1])
    plotting.plot_scores(scores[0].rows, ax=bars)
    plotting.plot_reliability(scores[1].points, ax=curve)
    figure.savefig(path, dpi=90)


def main(plot: Path | None, seeds: int, names: list[str]) -> None:
    scene = fixed_scene(jax.random.key(0))
    fits = [best_fit(fit_restarts(points, key=jax.random.key(0))) for points in (scene.before, scene.after)]
    mixtures = [fit.mixture for fit in fits]
    print("Gaussians before and after:", [int(mixture.count) for mixture in mixtures])
    print(f"EMD {float(earth_movers_distance(*mixtures).cost):.2f} m")
    search = grid_search(
        scene.after, key=jax.random.key(0), components=range(5, 9), covariance_types=("full", "diagonal")
    )
    print(f"grid search: {int(search.fit.mixture.count)} Gaussians, {search.covariance_type}")
    starts = fit_restarts(scene.after, key=jax.random.key(1), restarts=16)
    scores = scored(names, seeds)
    for row in scores[0].totals:
        print(f"{row.detector}: F1 {row.scores.f1:.2f}")
    if plot:
        draw(plot, scene, mixtures, (search, starts), scores)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", type=Path, help="picture to write, such as figures.png")
    parser.add_argument("--seeds", type=int, default=5, help="scenes of each condition that are scored")
    parser.add_argument("--detectors", nargs="+", default=["joint", "greedy", "c2c"], help="that are scored")
    options = parser.parse_args()
    main(options.plot, options.seeds, options.detectors)
