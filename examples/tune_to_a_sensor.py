"""Noise floor and registration tolerance, tuned to a sensor on a few scenes with truth.

The settings begin at those of a wrong sensor (noise three times too small, tolerance five times too large) and at the
defaults, and are judged on scenes that the tuning did not see. The tables of docs/tuning.md are made by

    python examples/tune_to_a_sensor.py gaussians --training 3 --unseen 5 --first-seed 9800
    python examples/tune_to_a_sensor.py laboratory --training 2 --unseen 3 --first-seed 9800
"""

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

from gmmjax import DetectionConfig, detect_changes
from gmmjax.evaluation import LabelledPair, Row, Scores, laboratory_pair, score_labelled_pair
from gmmjax.evaluation.gaussians import GAUSSIAN_FAMILIES, POINTS, gaussian_pair
from gmmjax.tuning import TuningSettings, scan_pair, tune

# What an expert would set, metres: the registration error of the scenes; for rooms, voxels' scatter and two spacings.
BY_HAND = {
    "gaussians": DetectionConfig(noise_floor=0.01, tolerance=0.1),
    "laboratory": DetectionConfig(noise_floor=0.0033, tolerance=0.023),
}


def scenes(kind: str, seeds: Sequence[int], points: int = POINTS) -> list[LabelledPair]:
    """Gaussians whose clouds are displaced against each other, or a room surveyed twice; poses unknown."""
    if kind == "gaussians":
        conditions = [dataclasses.replace(own, points=points) for own in GAUSSIAN_FAMILIES["shifted"]]
        pairs = [(str(own), gaussian_pair(own, seed)) for seed in seeds for own in conditions]
    else:
        changes = ("(+1)", "(-1 +1)", "(-2)", "(none)")
        as_surveyed = ("normal", "panorama", "unknown")
        pairs = [(own, laboratory_pair(own, seed, *as_surveyed)) for seed in seeds for own in changes]
    return [dataclasses.replace(pair, name=f"{condition}, {pair.name}") for condition, pair in pairs]


def scored(pairs: Sequence[LabelledPair], config: DetectionConfig) -> Scores:
    """The scores of all pairs with these settings."""
    total = Scores()
    for pair in pairs:
        changes = detect_changes(pair.before.points, pair.after.points, config=config)
        total += score_labelled_pair(pair, changes.labels_before, changes.labels_after)
    return total


def main() -> None:
    """Tunes from both starts, and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="?", choices=list(BY_HAND), default="gaussians")
    parser.add_argument("--training", type=int, default=1, help="seeds to train on, four scenes each")
    parser.add_argument("--unseen", type=int, default=1, help="seeds to judge by, four scenes each")
    parser.add_argument("--first-seed", type=int, default=9803)
    parser.add_argument("--points", type=int, default=POINTS, help="of each Gaussian; rooms have as many as are seen")
    parser.add_argument("--steps", type=int, default=TuningSettings.steps, help="of the optimiser at the most")
    parser.add_argument("--starts", type=int, default=TuningSettings.starts, help="that the search begins from")
    parser.add_argument("--max-points", type=int, default=TuningSettings.max_points, help="of a fit at the most")
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.training + options.unseen)
    training = [scan_pair(pair) for pair in scenes(options.scenes, seeds[: options.training], options.points)]
    unseen = scenes(options.scenes, seeds[options.training :], options.points)
    by_hand = BY_HAND[options.scenes]
    wrong = dataclasses.replace(by_hand, noise_floor=by_hand.noise_floor / 3, tolerance=5 * by_hand.tolerance)
    settings = TuningSettings(
        ("noise_floor", "tolerance"), steps=options.steps, starts=options.starts, max_points=options.max_points
    )
    of_wrong, of_default = tune(training, config=wrong, settings=settings), tune(training, settings=settings)
    rows = {
        "wrong sensor": wrong,
        "tuned from there": of_wrong.config,
        "set by hand": by_hand,
        "defaults": DetectionConfig(),
        "tuned from the defaults": of_default.config,
    }
    bars = []
    for evidence in (True, False) if options.scenes == "laboratory" else (True,):
        print(f"{len(unseen)} unseen scenes{'' if evidence else ', without the evidence test'}")
        print(f"{'':24}{'noise floor':>12}{'tolerance':>12}{'segment F1':>12}{'point F1':>12}{'false':>8}")
        for name, config in rows.items():
            scores = scored(unseen, dataclasses.replace(config, evidence=evidence))
            condition = "unseen scenes" if evidence else "without evidence"
            bars.append(Row(name, "", condition, len(unseen), 0, scores, None))
            values = [f"{value:.3g}" if value else "derived" for value in (config.noise_floor, config.tolerance)]
            figures = f"{scores.f1:12.3f}{scores.point_f1:12.3f}{scores.false_segments:8}"
            print(f"{name:24}{values[0]:>12}{values[1]:>12}{figures}")
    if options.plot:
        draw(options.plot, bars)


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
