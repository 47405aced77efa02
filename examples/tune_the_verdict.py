"""The verdict, tuned to a sensor that it was not learned from, on a few pairs with truth.

The sensor is a depth camera with multipath errors: patches of its frames return a range that is too short, so that
pieces of surfaces float in front of them. No family that the verdict was learned from has any. The tuned verdict is
judged on pairs that tuning did not see. The table of docs/tuning.md is made by

    python examples/tune_the_verdict.py --training 8 --unseen 16 --first-seed 9900

and, of sensors that the verdict was learned from, by the same with `--patches 0` and `--family`.
"""

import argparse
import dataclasses
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gmmjax import DetectionConfig, InputWarning, detect_changes
from gmmjax.changes import write_verdicts
from gmmjax.evaluation import LabelledCloud, LabelledPair, Row, Scores, family_pair, score_labelled_pair
from gmmjax.tuning import VerdictResult, scan_pair, tune_verdict, unchanged_pair


def with_multipath(cloud: LabelledCloud, random: np.random.Generator, patches: float) -> LabelledCloud:
    """The cloud with patches of unchanged surfaces that return 3 to 12 % too short a range, so many in each frame."""
    assert cloud.views is not None
    sensors, points = cloud.views.poses[:, :3, 3], cloud.points.copy()
    for _ in range(random.poisson(patches * len(sensors))):
        sensor = sensors[random.integers(len(sensors))]
        rays = cloud.points - sensor
        ranges = np.linalg.norm(rays, axis=1)
        middle = random.integers(len(points))
        within = rays @ rays[middle] > np.cos(random.uniform(0.01, 0.03)) * ranges * ranges[middle]
        within &= cloud.truth < 0
        points[within] = sensor + (1 - random.uniform(0.03, 0.12)) * rays[within]
    return dataclasses.replace(cloud, points=points)


def thinned(cloud: LabelledCloud, every: int) -> LabelledCloud:
    """Every so many of its points."""
    assert cloud.unseen is not None
    return dataclasses.replace(
        cloud, points=cloud.points[::every], truth=cloud.truth[::every], unseen=cloud.unseen[::every]
    )


def surveyed(family: str, seed: int, *, poses: bool, patches: float, every: int = 1) -> LabelledPair:
    """A pair of the family as the sensor sees it."""
    random, pair = np.random.default_rng(seed), family_pair(family, seed, "given")
    before, after = (with_multipath(thinned(cloud, every), random, patches) for cloud in (pair.before, pair.after))
    if not poses:
        before, after = (dataclasses.replace(cloud, views=None) for cloud in (before, after))
    return LabelledPair(f"{family} {seed}", before, after)


def scored(pairs: Sequence[LabelledPair], config: DetectionConfig) -> Scores:
    """The scores of all pairs with these settings."""
    total = Scores()
    for pair in pairs:
        before, after = pair.before, pair.after
        changes = detect_changes(
            before.points, after.points, config=config, views_before=before.views, views_after=after.views
        )
        total += score_labelled_pair(pair, changes.labels_before, changes.labels_after)
    return total


def main() -> None:
    """Tunes on labelled pairs, and on those of them where nothing changed, and prints a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--family", default="tabletop", help="of gmmjax.scenes.FAMILIES")
    parser.add_argument("--training", type=int, default=2, help="pairs to tune on")
    parser.add_argument("--unseen", type=int, default=1, help="pairs to judge by")
    parser.add_argument("--first-seed", type=int, default=9900)
    parser.add_argument("--patches", type=float, default=3.0, help="with multipath errors, a frame; 0: none")
    parser.add_argument("--every", type=int, default=1, help="of so many points one is used, to save time")
    parser.add_argument("--poses", action="store_true", help="the poses of the sensor are given")
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    options = parser.parse_args()
    # What tuning is for: registrations in doubt, and candidates unlike those that the verdict was learned from.
    warnings.simplefilter("ignore", InputWarning)
    seeds = range(options.first_seed, options.first_seed + options.training + options.unseen)
    pairs = [
        surveyed(options.family, seed, poses=options.poses, patches=options.patches, every=options.every)
        for seed in seeds
    ]
    training, unseen = pairs[: options.training], pairs[options.training :]
    unchanged = [
        unchanged_pair(pair.name, pair.before.points, pair.after.points, pair.before.views, pair.after.views)
        for pair in training
        if pair.unchanged
    ]
    tunings = {"labelled": [scan_pair(pair) for pair in training], "unchanged": unchanged}
    print(f"{len(unseen)} unseen pairs{'' if options.poses else ', poses unknown'}")
    print(f"{'':32}{'segment F1':>12}{'point F1':>12}{'false':>8}")
    table = {"shipped": scored(unseen, DetectionConfig())}
    print_row("shipped", table["shipped"])
    for name, own in tunings.items():
        if own:
            result = tune_verdict(own)
            title = f"tuned on {len(own)} {name}{'' if result.improved else ': not kept'}"
            table[title] = scored_with(result, unseen)
            print_row(title, table[title])
    if options.plot:
        rows = [Row(name, "", "unseen pairs", len(unseen), 0, scores, None) for name, scores in table.items()]
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


def scored_with(result: VerdictResult, pairs: Sequence[LabelledPair]) -> Scores:
    """The scores of all pairs with the verdicts that tuning gave: those that were shipped where no others were kept."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "tuned.json"
        write_verdicts(file, result.verdicts, result.made)
        return scored(pairs, DetectionConfig(verdict=str(file)))


def print_row(name: str, scores: Scores) -> None:
    """A row of the table."""
    print(f"{name:32}{scores.f1:12.3f}{scores.point_f1:12.3f}{scores.false_segments:8}")


if __name__ == "__main__":
    main()
