"""Measures the volumes of simulated changes: `python -m tests.benchmarks.volumes [--scenes N] [--kinds KIND ...]`.

What was gained and what was lost in the place of a scene's change are each beside their true volumes, as
`Changes.volume_totals` adds them up.
"""

import argparse
import json
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gmmjax import DetectionConfig, InputWarning, detect_changes
from gmmjax.changes import volume_totals
from tests.benchmarks.volumes.scenes import KINDS, VolumeScene, scene_of


class Result(NamedTuple):
    """What was gained or lost in a scene beside its truth.

    Attributes:
        kind: of change.
        seed: of the scene.
        ratio: measured by true volume; 0 where no change has one.
        error: half-width of the interval by the true volume; None where there is none.
    """

    kind: str
    seed: int
    ratio: float
    error: float | None


def measured(scene: VolumeScene, seed: int) -> Iterator[Result]:
    """The volumes of the changes in the place of a scene."""
    clouds, views = scene.survey.clouds, scene.survey.views
    config = DetectionConfig(registration=scene.registration)
    changes = detect_changes(*clouds, config=config, views_before=views.before, views_after=views.after)
    totals = volume_totals([one for one in changes if np.linalg.norm(one.box.centre - scene.place) <= scene.reach])
    both = bool(scene.gained and scene.lost)
    sides = ("gained", totals.gained, totals.gained_error), ("lost", totals.lost, totals.lost_error)
    for (side, found, error), true in zip(sides, (scene.gained, scene.lost), strict=True):
        if true:
            name = f"{scene.kind}: {side}" if both else scene.kind
            yield Result(name, seed, found / true, None if error is None else error / true)


def row(name: str, results: Sequence[Result]) -> str:
    """A row of the table."""
    found = [result for result in results if result.ratio]
    sure = [result for result in found if result.error is not None]
    cells = [name, str(len(results)), str(len(found))]
    if found:
        ratios = np.array([result.ratio for result in found])
        cells += [f"{100 * np.median(np.abs(ratios - 1)):.1f} %", f"{100 * (ratios.mean() - 1):+.1f} %"]
    if sure:
        holds = np.mean([abs(result.ratio - 1) <= result.error for result in sure if result.error is not None])
        cells += [f"{100 * np.median([result.error for result in sure]):.1f} %", f"{100 * holds:.0f} %"]
    return f"| {' | '.join(cells + [''] * (7 - len(cells)))} |"


def table(results: Sequence[Result]) -> str:
    """The results of each kind."""
    names = ("change", "scenes", "found", "median error", "mean error", "half-width", "interval holds")
    heading = f"| {' | '.join(names)} |\n|{'---|' * len(names)}"
    kinds = dict.fromkeys(result.kind for result in results)
    return "\n".join([heading, *(row(kind, [one for one in results if one.kind == kind]) for kind in kinds)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=7, help="of each kind")
    parser.add_argument("--seed", type=int, default=100, help="of the first one")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    options = parser.parse_args()
    results = []
    for seed in range(options.seed, options.seed + options.scenes):
        for kind in options.kinds:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)
                found = list(measured(scene_of(kind, seed), seed))
            print(*(json.dumps(result._asdict()) for result in found), sep="\n", file=sys.stderr, flush=True)
            results += found
    print(table(results))


if __name__ == "__main__":
    main()
