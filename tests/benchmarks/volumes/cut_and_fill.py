"""Volumes of cut and fill that touch: `python -m tests.benchmarks.volumes.cut_and_fill [--scenes N]`.

On slopes of 15 to 80 m ground is taken away in one place and deposited beside it. What was gained and what was lost are
each beside their true volumes; one of them is not found where none of it is reported.
"""

import argparse
import json
import sys
import warnings
from collections.abc import Iterator

import numpy as np

from gmmjax import DetectionConfig, InputWarning, detect_changes
from gmmjax.changes import volume_totals
from gmmjax.pair import Pair
from tests.benchmarks.volumes.results import Result, table
from tests.benchmarks.volumes.scenes import (
    GROUND_KINDS,
    HELD_OUT_GROUND,
    Truth,
    VolumeScene,
    ground_of,
    integral,
    local,
    slope,
    surveyed,
)

SEED = 90_000
COMING = [shape for shape in (*GROUND_KINDS.values(), *HELD_OUT_GROUND.values()) if shape.sign > 0]
GOING = [shape for shape in (*GROUND_KINDS.values(), *HELD_OUT_GROUND.values()) if shape.sign < 0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=24)
    parser.add_argument("--seed", type=int, default=SEED, help="of the first one")
    options = parser.parse_args()
    results = []
    for seed in range(options.seed, options.seed + options.scenes):
        for result in measured(seed):
            print(json.dumps(result._asdict()), file=sys.stderr, flush=True)
            results.append(result)
    print(table(results))


def measured(seed: int) -> Iterator[Result]:
    """What was gained and what was lost in a scene."""
    scene, lost = scene_of(seed)
    clouds, views = scene.survey.clouds, scene.survey.views
    config = DetectionConfig(registration=scene.registration)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        changes = detect_changes(*clouds, config=config, views_before=views.before, views_after=views.after)
    own = [change for change in changes if np.linalg.norm(change.box.centre - scene.place) <= scene.reach]
    totals = volume_totals(own)
    gained = totals.gained / scene.volume, totals.gained_error / scene.volume
    yield Result("gained", seed, totals.gained > 0, *gained)
    yield Result("lost", seed, totals.lost > 0, totals.lost / lost, totals.lost_error / lost)


def scene_of(seed: int) -> tuple[VolumeScene, float]:
    """A scene, whose volume is what was gained, and what was lost in it."""
    random = np.random.default_rng(seed)
    edge = float(np.exp(random.uniform(np.log(15), np.log(80))))
    heights = slope(random, edge, steepest=30, relief=1.0)
    radii = random.uniform(0.08, 0.14, 2) * edge
    middle, angle = random.uniform(-0.2, 0.2, 2) * edge, random.uniform(0, 2 * np.pi)
    apart = random.uniform(0.8, 1.0) * radii.sum() / 2 * np.array([np.cos(angle), np.sin(angle)])
    bumps = []
    for shapes, place, radius in ((COMING, middle + apart, radii[0]), (GOING, middle - apart, radii[1])):
        shape = shapes[int(random.integers(len(shapes)))]
        thickness = min(random.uniform(*shape.thickness) * (edge / 30) ** 0.5, 0.7 * radius)
        u, v = local(edge, place, np.full(2, radius), random.uniform(0, np.pi))
        bumps.append(shape.sign * thickness * shape.profile(random, u, v))
    # Where both would be, it is one of them.
    change = np.where(np.abs(bumps[0]) >= np.abs(bumps[1]), *bumps)
    grounds = Pair(ground_of(heights, edge), ground_of(heights + change, edge))
    gained, lost = integral(np.maximum(change, 0), edge), integral(np.maximum(-change, 0), edge)
    place = np.array([*middle, grounds.before.height_at(middle[None])[0]])
    truth = Truth("cut and fill", gained, place, 1.2 * float(radii.sum()))
    scene = surveyed(random, truth, grounds.map(lambda own: [own]), edge, grounds.before)
    return scene, lost * scene.volume / gained


if __name__ == "__main__":
    main()
