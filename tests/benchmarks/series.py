"""How many histories of objects are exactly right in simulated series: `python -m tests.benchmarks.series`.

Each series is a room that a depth camera surveys again and again, in which things come, move and go. Every survey has
noise of its own and is misregistered by up to 15 mm and 0.4 degrees. Each epoch is compared with the one before. A
history is exactly right when the same events happen to the same thing in the same epochs. `--lost 12` takes up to 12 of
its 16 frames from each survey, one after the other, so that parts are not observed.
"""

import argparse
import itertools
from collections import Counter

from gmmjax import detect_changes
from gmmjax.batch import Comparison, object_histories
from gmmjax.pair import Pair
from tests.batch.series_scenes import Series, series


def comparisons(scene: Series, restarts: int) -> list[Comparison]:
    """Of each epoch but the first with the one before."""
    found = []
    for pair in itertools.pairwise(range(len(scene.clouds))):
        clouds = Pair(*pair).map(lambda epoch: scene.clouds[epoch])
        found.append(Comparison.of(*pair, detect_changes(*clouds, restarts=restarts), clouds))
    return found


def score(scene: Series, restarts: int) -> Counter[str]:
    """True objects and events, those found, and those that are exactly right."""
    names = [str(epoch) for epoch in range(len(scene.clouds))]
    histories = object_histories(names, comparisons(scene, restarts))
    found = Counter(scene.told(history) for history in histories)
    truth = Counter(scene.truth())
    events = [
        Counter((thing, event) for (thing, own), count in stories.items() for event in own * count)
        for stories in (truth, found)
    ]
    return Counter(
        {
            "objects": truth.total(),
            "found": found.total(),
            "right": (truth & found).total(),
            "events": events[0].total(),
            "events found": events[1].total(),
            "events right": (events[0] & events[1]).total(),
        }
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--series", type=int, default=5, help="number of series")
    parser.add_argument("--epochs", type=int, default=6, help="surveys of each")
    parser.add_argument("--restarts", type=int, default=2, help="of each detection")
    parser.add_argument("--lost", type=int, default=0, help="most frames of the 16 of a survey that are lost")
    arguments = parser.parse_args()
    total = Counter[str]()
    for seed in range(arguments.series):
        own = score(series(seed, arguments.epochs, lost=arguments.lost), arguments.restarts)
        total += own
        print(f"series {seed}: {dict(own)}", flush=True)
    print("", "| objects | found | exactly right | events | found | right |", "|---" * 6 + "|", sep="\n")
    names = ("objects", "found", "right", "events", "events found", "events right")
    print("| " + " | ".join(str(total[name]) for name in names) + " |")


if __name__ == "__main__":
    main()
