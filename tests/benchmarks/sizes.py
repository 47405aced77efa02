"""Sizes and places of changes beside those of the truth's points: `python -m tests.benchmarks.sizes`.

Storehouses, rooms, halls and tables with known poses; one row a kind of scene, and one for all.
"""

import argparse
import warnings

import numpy as np

from gmmjax import Changes, InputWarning, detect_changes
from gmmjax.geometry import smallest_box
from gmmjax.scenes import SurveyedScene, storehouse
from gmmjax.scenes.families import FAMILIES

KINDS = ("rooms", "halls", "tabletop")
# Points of the truth, at least, that a size is told from.
FEWEST = 100


def differences(scene: SurveyedScene) -> list[tuple[float, float]]:
    """Of each change the greatest difference of an edge and the distance of the centres, in voxels or spacings."""
    views = {"views_before": scene.views.before, "views_after": scene.views.after}
    changes = detect_changes(scene.clouds.before, scene.clouds.after, **views)
    resolution = changes.diagnostics["voxel_size"] or changes.diagnostics["spacing"]
    rows = []
    for label, change in enumerate(changes):
        points = true_points(scene, changes, label)
        if len(points) >= FEWEST:
            box = smallest_box(points, 24)
            edges = np.abs(np.sort(change.box.extent) - np.sort(box.extent)).max()
            rows.append((edges / resolution, np.linalg.norm(change.box.centre - box.centre) / resolution))
    return rows


def true_points(scene: SurveyedScene, changes: Changes, label: int) -> np.ndarray:
    """All points of the true change that most points of a change are of, registered; none of a false one."""
    side = "before" if (changes.labels_before == label).any() else "after"
    truth, points = getattr(scene.truth, side), np.asarray(getattr(scene.clouds, side))
    number = np.bincount(truth[getattr(changes, f"labels_{side}") == label] + 1).argmax() - 1
    own = points[truth == number] if number >= 0 else points[:0]
    return own if side == "before" else changes.registration.apply(own)


def row(name: str, found: list[tuple[float, float]]) -> str:
    """A row of the table."""
    edges, centres = np.array(found).T
    shares = [f"{100 * np.mean(values <= most):.0f} %" for values, most in ((edges, 1), (edges, 2), (centres, 1))]
    return f"| {' | '.join([name, str(len(found)), *shares])} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=6, help="of each kind")
    parser.add_argument("--seed", type=int, default=200, help="of the first one")
    options = parser.parse_args()
    seeds, total = range(options.seed, options.seed + options.scenes), []
    print("| scenes | changes | edges within a voxel | within two | centre within one |\n|---|---|---|---|---|")
    makers = {"storehouse": lambda seed: storehouse(seed).scene}
    makers |= {name: lambda seed, name=name: FAMILIES[name](np.random.default_rng(seed)) for name in KINDS}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        for name, scene in makers.items():
            found = [one for seed in seeds for one in differences(scene(seed))]
            total += found
            print(row(name, found))
    print(row("all", total))


if __name__ == "__main__":
    main()
