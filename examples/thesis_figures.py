"""The figures of the thesis's method and results, drawn from scenes that are simulated here."""

import argparse
from pathlib import Path

import jax
from matplotlib.figure import Figure

from gmmjax import GaussianMixture, detect_changes, earth_movers_distance, use_compilation_cache
from gmmjax.evaluation import ReliabilityRecord, detector, evaluate, gaussian_sources
from gmmjax.mixtures import best_fit, fit_restarts, grid_search
from gmmjax.plotting import (
    plot_changes,
    plot_grid_search,
    plot_message_length,
    plot_mixture,
    plot_reliability,
    plot_scores,
    plot_transport,
)
from gmmjax.scenes import GaussianScene, fixed_scene

DETECTORS = ("joint", "greedy", "c2c")


def new_figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="compressed")


def clustering(scene: GaussianScene, mixtures: list[GaussianMixture]) -> Figure:
    """Figures 3.2 and 4.1: four Gaussians before, seven after, and the changes."""
    figure = new_figure(13, 4.6)
    axes = figure.subplots(1, 3)
    for ax, name, points, mixture in zip(
        axes, ("Before", "After"), (scene.before, scene.after), mixtures, strict=False
    ):
        plot_mixture(mixture, points, unit="m", ax=ax)
        ax.set_title(f"{name}: {int(mixture.count)} Gaussians")
    changes = detect_changes(scene.before, scene.after)
    print(f"clustering: {changes!r}")
    plot_changes(changes, direction="oblique", ax=axes[2])
    axes[2].set_title("Changes")
    return figure


def transport(mixtures: list[GaussianMixture]) -> Figure:
    """Figure 2.1: how mass flows between two mixtures."""
    figure = new_figure(6.5, 6)
    result = earth_movers_distance(*mixtures)
    print(f"transport: EMD {float(result.cost):.2f} m")
    plot_transport(*mixtures, result, unit="m", ax=figure.subplots())
    return figure


def searches(scene: GaussianScene) -> Figure:
    """Figure 3.9, the grid search over numbers of Gaussians and covariances, beside the message lengths of our fits."""
    figure = new_figure(12, 4.4)
    axes = figure.subplots(1, 2)
    search = grid_search(scene.after, key=jax.random.key(0), components=range(3, 10))
    plot_grid_search(search, criterion="mdl", ax=axes[0])
    axes[0].set_title("Grid search, 7 Gaussians in truth")
    plot_message_length(fit_restarts(scene.after, key=jax.random.key(1), restarts=16), ax=axes[1])
    axes[1].set_title("Annihilation from 16 starts")
    return figure


def scores(seeds: int) -> tuple[Figure, Figure]:
    """Figure 4.9, F1 by condition, and how reliable the probabilities are."""
    record = ReliabilityRecord()
    sources = [source for source in gaussian_sources(range(seeds)) if source.condition.endswith("low")]
    found = evaluate({name: detector(name) for name in DETECTORS}, sources, record=record.add)
    print(f"scores: {len(found.rows)} rows, {len(found.failures)} failures")
    bars, curve = new_figure(12, 4.4), new_figure(5.8, 5.6)
    plot_scores(found.rows, ax=bars.subplots())
    plot_reliability({"joint": record.points["joint"], "greedy": record.points["greedy"]}, ax=curve.subplots())
    return bars, curve


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("thesis-figures"), help="folder for the figures")
    parser.add_argument("--seeds", type=int, default=5, help="scenes of each condition that are scored")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    use_compilation_cache()
    scene = fixed_scene(jax.random.key(0))
    fits = [best_fit(fit_restarts(points, key=jax.random.key(0))) for points in (scene.before, scene.after)]
    mixtures = [fit.mixture for fit in fits]
    bars, curve = scores(options.seeds)
    figures = {
        "clustering": clustering(scene, mixtures),
        "transport": transport(mixtures),
        "searches": searches(scene),
        "scores": bars,
        "reliability": curve,
    }
    for name, figure in figures.items():
        figure.savefig(options.out / f"{name}.png", dpi=120)
        print(options.out / f"{name}.png")


if __name__ == "__main__":
    main()
