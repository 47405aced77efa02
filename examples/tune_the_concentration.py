"""The concentration of the weights, tuned to scenes of small objects.

Where objects have some forty points it matters how many a Gaussian needs to stay: with a lenient prior, spurious ones
that explain a few points by chance split the objects. The concentration is learned from scenes with truth, from a
lenient start, and judged on others beside Figueiredo and Jain's. The table of docs/tuning.md is made by

    python examples/tune_the_concentration.py --training 8 --unseen 16 --first-seed 9850
"""

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

from gmmjax import DetectionConfig, detect_changes
from gmmjax.evaluation import Condition, LabelledPair, Row, Scores, score_labelled_pair
from gmmjax.evaluation.gaussians import gaussian_pair
from gmmjax.tuning import TuningSettings, scan_pair, tune

POINTS = 40


def scenes(seeds: Sequence[int]) -> list[LabelledPair]:
    """Five Gaussians of forty points, of which one goes and another comes."""
    conditions = [Condition(1, 1, overlap, points=POINTS) for overlap in ("low", "medium")]
    return [
        dataclasses.replace(gaussian_pair(condition, seed), name=f"{condition}, seed {seed}")
        for seed in seeds
        for condition in conditions
    ]


def main() -> None:
    """Tunes, and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--training", type=int, default=2, help="seeds to train on, two scenes each")
    parser.add_argument("--unseen", type=int, default=2, help="seeds to judge by, two scenes each")
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--steps", type=int, default=TuningSettings.steps, help="of the optimiser at the most")
    parser.add_argument("--starts", type=int, default=TuningSettings.starts, help="that the search begins from")
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.training + options.unseen)
    training = [scan_pair(pair) for pair in scenes(seeds[: options.training])]
    lenient = DetectionConfig(concentration=-1.0)
    settings = TuningSettings(parameters=("concentration",), steps=options.steps, starts=options.starts)
    result = tune(training, config=lenient, settings=settings)
    print(f"on {len(training)} scenes the loss went from {result.baseline[0]:.3f} to {result.best[0]:.3f}")
    unseen, rows = scenes(seeds[options.training :]), []
    for name, config in (("lenient", lenient), ("tuned", result.config), ("Figueiredo and Jain", DetectionConfig())):
        total = Scores()
        for pair in unseen:
            changes = detect_changes(pair.before.points, pair.after.points, config=config)
            total += score_labelled_pair(pair, changes.labels_before, changes.labels_after)
        rows.append(Row(name, "", "unseen scenes", len(unseen), 0, total, None))
        value = "1 - T/2" if config.concentration is None else f"{config.concentration:.3g}"
        print(f"{name:20} concentration {value:>8}: segment F1 {total.f1:.3f}, point F1 {total.point_f1:.3f}")
    if options.plot:
        draw(options.plot, rows)


def draw(file: Path, rows: list[Row]) -> None:
    """The segment F1 and the point F1 as bars."""
    from matplotlib import pyplot

    from gmmjax.plotting import plot_scores

    figure, panels = pyplot.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for ax, measure in zip(panels, ("f1", "point_f1"), strict=True):
        plot_scores(rows, measure=measure, ax=ax)
    panels[0].get_legend().remove()
    figure.savefig(file)


if __name__ == "__main__":
    main()
