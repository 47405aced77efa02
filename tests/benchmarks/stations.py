"""How many stations of scanners are recognised in their scans: `python -m tests.benchmarks.stations`.

Scenes of `tests.benchmarks.held_out`, and of families of the training, in any unit. Both surveys of each scene count.
What is further than half of a station's height above the ground from every station is false; of scanners that are
carried and of other sensors, all is.
"""

import argparse
import sys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gmmjax.clouds import recognised_stations
from gmmjax.learning import training_sources
from tests.benchmarks.held_out import held_out_pair

HEADINGS = ("scans", "surveys", "stations", "recognised", "false", "largest error across", "in height")
SURVEYED = ("hall", "slope")
TRIPODS = ("halls", "apartments", "depots", "earthworks")
OTHERS = ("corridors", "town", "terrain", "rooms", "kitchens", "laboratory")
# Further away it is another place, in heights of the station above the ground.
FARTHEST = 0.5


class Survey(NamedTuple):
    """A scan with the places of its scanner.

    Attributes:
        points: of the scan.
        stations: places of the scanner's mirror; none of one that was carried.
    """

    points: np.ndarray
    stations: np.ndarray


class Count(NamedTuple):
    """What was recognised in a survey.

    Attributes:
        stations: there are.
        errors: of each that was recognised, across and in height, in its height above the ground [n, 2].
        false: places that are none.
    """

    stations: int
    errors: np.ndarray
    false: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(6)))
    parser.add_argument("--points", type=int, default=400_000, help="a side, of surveyed scenes")
    parser.add_argument("--scans", nargs="+", default=[*SURVEYED, *TRIPODS, *OTHERS])
    arguments = parser.parse_args()
    print("| " + " | ".join(HEADINGS) + " |", "|---" * len(HEADINGS) + "|", sep="\n")
    for scans in arguments.scans:
        counts = [
            counted(survey) for seed in arguments.seeds for survey in surveys(scans, seed, points=arguments.points)
        ]
        print("| " + " | ".join(cells(scans, counts)) + " |")
        sys.stdout.flush()


def surveys(scans: str, seed: int, *, points: int) -> Iterator[Survey]:
    """Both surveys of a scene."""
    if scans in SURVEYED:
        pair = held_out_pair(scans, seed, True, points=points)
        for cloud in (pair.before, pair.after):
            assert cloud.views is not None
            yield Survey(cloud.points, cloud.views.poses[:, :3, 3])
        return
    (source,) = training_sources(scans, [seed])
    scene = source.load()
    for cloud in (scene.before, scene.after):
        assert cloud.views is not None
        stations = cloud.views.poses[:, :3, 3] if scans in TRIPODS else np.empty((0, 3))
        yield Survey(cloud.points, stations)


def heights(survey: Survey) -> np.ndarray:
    """Of the stations above the ground: the lowest of the fifth of the points that are nearest to each."""
    above = []
    for station in survey.stations:
        distance = np.linalg.norm(survey.points[:, :2] - station[:2], axis=1)
        near = survey.points[distance <= np.quantile(distance, 0.2), 2]
        above.append(station[2] - np.quantile(near, 0.02))
    return np.array(above)


def counted(survey: Survey) -> Count:
    """What is recognised in a survey."""
    found, stations = recognised_stations(survey.points), survey.stations
    if not len(stations):
        return Count(0, np.empty((0, 2)), len(found))
    offsets = (found[:, None] - stations) / heights(survey)[:, None]
    distance = np.linalg.norm(offsets, axis=2)
    near = distance.min(axis=1) < FARTHEST
    own = offsets[near, distance[near].argmin(axis=1)] if near.any() else np.empty((0, 3))
    errors = np.column_stack([np.linalg.norm(own[:, :2], axis=1), np.abs(own[:, 2])])
    return Count(len(stations), errors, int((~near).sum()))


def cells(scans: str, counts: list[Count]) -> list[str]:
    """A row of the table."""
    errors = np.concatenate([own.errors for own in counts])
    worst = [f"{value:.2f}" for value in errors.max(axis=0)] if len(errors) else ["", ""]
    totals = sum(own.stations for own in counts), len(errors), sum(own.false for own in counts)
    return [scans, str(len(counts)), *(f"{total}" for total in totals), *worst]


if __name__ == "__main__":
    main()
