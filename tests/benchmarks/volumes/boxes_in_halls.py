"""Volumes of boxes in halls: `python -m tests.benchmarks.volumes.boxes_in_halls --seeds 0 1 2`.

The boxes of 0.2 to 1 m that come, go or move in the simulated halls of `tests/benchmarks/surveyor`, among racks and
goods, each beside its true volume. A box counts as found where four fifths of the points of a change are its own.
"""

import argparse
import json
import sys
import warnings
from collections.abc import Iterator

import numpy as np

from gmmjax import InputWarning, detect_changes
from gmmjax.changes import Change, Changes
from gmmjax.pair import Pair, each
from tests.benchmarks.surveyor.kinds import drawn_from, kind_of, simulated
from tests.benchmarks.surveyor.scanning import World
from tests.benchmarks.surveyor.solids import UNCHANGED
from tests.benchmarks.volumes.results import Result, table

# Of the points of a change that are of one box.
OWN = 0.8


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", nargs="+", type=int, default=list(range(18)))
    parser.add_argument("--points", type=int, default=400_000, help="about so many a side")
    options = parser.parse_args()
    results = []
    for seed in options.seeds:
        for result in in_hall(seed, options.points):
            print(json.dumps(result._asdict()), file=sys.stderr, flush=True)
            results.append(result)
    print(table(results))


def in_hall(seed: int, points: int) -> Iterator[Result]:
    """The boxes of a hall, poses given."""
    worlds = kind_of("hall").site(drawn_from("hall", seed), True).worlds
    pair = simulated("hall", seed, points)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        found = detect_changes(*pair.points, views_before=pair.views.before, views_after=pair.views.after)
    measured = each(lambda labels, source: _by_source(found, labels, source), _labels(found), pair.source)
    for after, (world, own) in enumerate(zip(worlds, measured, strict=True)):
        for number, volume in boxes_of(world).items():
            change = own.get(number)
            if change is None or change.volume is None:
                yield Result("box that came" if after else "box that went", seed, False)
                continue
            assert change.volume_error is not None
            sense = 1 if (change.gain_or_loss == "gain") == bool(after) else -1
            ratio, error = sense * change.volume / volume, change.volume_error / volume
            yield Result("box that came" if after else "box that went", seed, True, ratio, error)


def boxes_of(world: World) -> dict[int, float]:
    """The volume of each box that is there at one time only, by the number of its change."""
    return {
        thing.change: float(np.prod(2 * thing.bodies[0].half))
        for thing in world.things
        if thing.change != UNCHANGED and len(thing.bodies) == 1 and thing.bodies[0].shape == "box"
    }


def _labels(found: Changes) -> Pair[np.ndarray]:
    return Pair(found.labels_before, found.labels_after)


def _by_source(found: Changes, labels: np.ndarray, source: np.ndarray) -> dict[int, Change]:
    """The change that is of each thing, where one has most of it."""
    changes: dict[int, Change] = {}
    for index in np.unique(labels[labels >= 0]):
        numbers, counts = np.unique(source[labels == index], return_counts=True)
        most = int(counts.argmax())
        if numbers[most] >= 0 and counts[most] >= OWN * counts.sum():
            number, change = int(numbers[most]), found[int(index)]
            if number not in changes or change.point_count > changes[number].point_count:
                changes[number] = change
    return changes


if __name__ == "__main__":
    main()
