"""Measures the volumes of simulated changes: `python -m tests.benchmarks.volumes [--development] [--scenes N]`.

A scene counts by the sum of the volumes of the changes in its place, as `Changes.volume_totals` adds them up. The
figures of docs/results.md are of the kinds and seeds that nothing was developed on.
"""

import argparse
import json
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gmmjax import DetectionConfig, InputWarning, detect_changes
from gmmjax.changes import volume_totals
from tests.benchmarks.volumes.results import Result, table
from tests.benchmarks.volumes.scenes import HELD_OUT, KINDS, TALL, VolumeScene, scene_of

DEVELOPMENT_SEED, REPORTED_SEED = 1000, 80_000


def measured(scene: VolumeScene, seed: int) -> Result:
    """The volume of the changes in the place of a scene."""
    clouds, views = scene.survey.clouds, scene.survey.views
    config = DetectionConfig(registration=scene.registration)
    changes = detect_changes(*clouds, config=config, views_before=views.before, views_after=views.after)
    own = [change for change in changes if np.linalg.norm(change.box.centre - scene.place) <= scene.reach]
    if not any(change.volume is not None for change in own):
        return Result(scene.kind, seed, False)
    totals = volume_totals(own)
    return Result(scene.kind, seed, True, totals.net / scene.volume, totals.net_error / abs(scene.volume))


def results_of(kinds: Sequence[str], seeds: range) -> list[Result]:
    """One scene after the other, each of the next kind; what was found is printed as it comes."""
    found = []
    for seed in seeds:
        kind = kinds[seed % len(kinds)]
        result = measured(scene_of(kind, seed), seed)
        print(json.dumps(result._asdict()), file=sys.stderr, flush=True)
        found.append(result)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=104, help="how many, of all kinds in turn")
    parser.add_argument("--seed", type=int, help="of the first one")
    parser.add_argument("--development", action="store_true", help="the kinds and seeds of development")
    parser.add_argument("--kinds", nargs="+", choices=[*KINDS, *HELD_OUT, *TALL], help="these in turn in place of all")
    parser.add_argument("--out", type=Path, help="a file for the results as JSON")
    options = parser.parse_args()
    kinds = options.kinds or list(KINDS if options.development else HELD_OUT)
    first = options.seed if options.seed is not None else DEVELOPMENT_SEED if options.development else REPORTED_SEED
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        results = results_of(kinds, range(first, first + options.scenes))
    if options.out is not None:
        options.out.write_text(json.dumps([result._asdict() for result in results]))
    print(table(results))


if __name__ == "__main__":
    main()
