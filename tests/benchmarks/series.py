"""How many histories of objects are exactly right in simulated series: `python -m tests.benchmarks.series`.

Each series is a room that a depth camera surveys again and again, in which things come, move and go. Every survey has
noise of its own and is misregistered by up to 15 mm and 0.4 degrees. Each epoch is compared with the one before, and
with the first one. A history is exactly right when the same events happen to the same thing in the same epochs.
`--lost 12` takes up to 12 of its 16 frames from each survey, one after the other, so that parts are not observed.
"""

import argparse
from collections import Counter
from collections.abc import Iterable

from gmmjax import detect_changes
from gmmjax.batch import Comparison, object_histories
from gmmjax.pair import Pair
from tests.batch.series_scenes import Series, series

AGAINST = ("previous", "first")


def compared(scene: Series, pairs: Iterable[tuple[int, int]], restarts: int) -> list[Comparison]:
    """Of pairs of epochs."""
    found = []
    for epochs in pairs:
        clouds = Pair(*epochs).map(lambda epoch: scene.clouds[epoch])
        found.append(Comparison.of(*epochs, detect_changes(*clouds, restarts=restarts), clouds))
    return found


def comparisons(scene: Series, against: str, restarts: int) -> list[Comparison]:
    """Of each epoch but the first with the one before, or with the first one."""
    later = range(1, len(scene.clouds))
    return compared(scene, [(epoch - 1 if against == "previous" else 0, epoch) for epoch in later], restarts)


def score(scene: Series, against: str, restarts: int) -> Counter[str]:
    """True objects and events, those found, and those that are exactly right."""
    names = [str(epoch) for epoch in range(len(scene.clouds))]
    histories = object_histories(names, comparisons(scene, against, restarts))
    found = Counter(scene.told(history) for history in histories)
    truth = Counter(scene.truth(against))
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
    totals = {against: Counter[str]() for against in AGAINST}
    for seed in range(arguments.series):
        scene = series(seed, arguments.epochs, lost=arguments.lost)
        for against in AGAINST:
            own = score(scene, against, arguments.restarts)
            totals[against] += own
            print(f"series {seed}, against {against}: {dict(own)}", flush=True)
    print("", "| against | objects | found | exactly right | events | found | right |", "|---" * 7 + "|", sep="\n")
    for against, total in totals.items():
        names = ("objects", "found", "right", "events", "events found", "events right")
        print(f"| {against} | " + " | ".join(str(total[name]) for name in names) + " |")


if __name__ == "__main__":
    main()
