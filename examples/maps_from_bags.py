"""What changed between two recordings of a robot: bags, refined maps, detection.

`python examples/maps_from_bags.py` simulates two surveys of a laboratory; with the names of two bags, each with one
topic of point clouds and poses on /tf, it takes those. Needs rosbags: `pip install '.[ros]'`.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from gmmjax import detect_changes
from gmmjax.surveys import LocalisedMap, localised_map, open_bag, sensor_trajectory, write_bag
from gmmjax.thesis.laboratory import recorded_run


def simulated_bags(folder: Path) -> list[Path]:
    """An empty laboratory, and one with a robot and a cargo bag."""
    paths = []
    for run in ("run5", "run1"):
        recording = recorded_run(run, seed=1, frames=10)
        paths.append(folder / f"{run}.bag")
        write_bag(paths[-1], recording.frames, recording.localised, sensor_on_body=recording.sensor_on_body)
    return paths


def map_of(path: Path) -> LocalisedMap:
    """The frames of a bag by the poses on /tf, moved a little so that they fit together."""
    with open_bag(path) as bag:
        sensor = next(bag.frames()).name
        return localised_map(bag.frames(), sensor_trajectory(bag, "/tf", sensor), refine=True)


def main(paths: list[Path], plot: Path | None) -> None:
    before, after = (map_of(path) for path in paths)
    for path, laid in zip(paths, (before, after), strict=True):
        print(f"{path.name}: {laid.frames_used} frames, {len(laid.points)} points, refined: {laid.refined}")
    changes = detect_changes(before.points, after.points, views_before=before.views, views_after=after.views)
    for change in changes:
        print(f"{change.kind} at {np.round(change.mean, 2).tolist()}, probability {change.probability:.2f}")
    if plot:
        changes.plot()[0, 0].figure.savefig(plot)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bags", type=Path, nargs="*", help="of the survey before and the survey after")
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    options = parser.parse_args()
    if len(options.bags) not in (0, 2):
        parser.error("give two bags, or none")
    with tempfile.TemporaryDirectory() as temporary:
        main(options.bags or simulated_bags(Path(temporary)), options.plot)
