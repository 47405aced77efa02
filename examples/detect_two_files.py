"""What changed between two files.

`python examples/detect_two_files.py` simulates a pair of scans; with the names of two files, of any format that gmmjax
reads, it takes those.
"""

import argparse
import tempfile
from pathlib import Path

import jax
import numpy as np

from gmmjax import Changes, DetectionConfig, detect_changes, read_cloud
from gmmjax.clouds import write_ply
from gmmjax.scenes import random_scene


def simulated_pair(folder: Path) -> tuple[Path, Path]:
    """Five Gaussians; one disappears, another one appears."""
    scene = random_scene(jax.random.key(0), start=5, appeared=1, disappeared=1, points=300)
    before, after = folder / "before.ply", folder / "after.ply"
    write_ply(before, scene.before)
    write_ply(after, scene.after)
    return before, after


def report(changes: Changes) -> None:
    for label, change in enumerate(changes):
        centre = np.round(change.mean, 2).tolist()
        print(f"{label}: {change.kind} at {centre}, {change.point_count} points, probability {change.probability:.2f}")
    for side, labels in (("before", changes.labels_before), ("after", changes.labels_after)):
        print(f"{side}: {(labels >= 0).sum()} of {len(labels)} points changed")


def main(before: Path, after: Path, folder: Path, plot: Path | None) -> None:
    # Things may have appeared and disappeared: partial transport finds both together.
    config = DetectionConfig(method="transport", restarts=4)
    changes = detect_changes(read_cloud(before), read_cloud(after), config=config)
    report(changes)
    changes.save(folder / "result")
    assert len(Changes.load(folder / "result")) == len(changes)
    if plot:
        changes.plot()[0, 0].figure.savefig(plot)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="*", help="the scan before and the scan after")
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    options = parser.parse_args()
    if len(options.files) not in (0, 2):
        parser.error("give two files, or none")
    with tempfile.TemporaryDirectory() as temporary:
        main(*(options.files or simulated_pair(Path(temporary))), Path(temporary), options.plot)
