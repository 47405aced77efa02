"""Many pairs at once: in memory as they are done, and in a folder that a later run goes on with."""

import argparse
import tempfile
from pathlib import Path

import jax

from gmmjax import DetectionConfig
from gmmjax.batch import BatchPair, BatchResult, detect_many
from gmmjax.scenes import random_scene


def main(plot: Path | None) -> None:
    """Detects in three pairs, and then adds restarts to what was kept."""
    pairs = []
    for seed in range(3):
        scene = random_scene(jax.random.key(seed), appeared=seed % 2)
        # Paths of files are taken, too, and read by the workers.
        pairs.append(BatchPair(f"scene {seed}", scene.before, scene.after))

    found = sorted(detect_many(pairs, config=DetectionConfig(restarts=2)), key=lambda result: result.name)
    for result in found:
        print(result.name, f"{result.pair.changes} changes", [change.kind for change in result.changes()])

    with tempfile.TemporaryDirectory() as folder:
        for restarts in (2, 4):
            results = list(detect_many(pairs, out=folder, config=DetectionConfig(restarts=restarts)))
            reused = sum(result.reused for result in results)
            print(f"{restarts} restarts: {len(results)} pairs, {reused} of them from before")

    if plot:
        draw(plot, pairs, found)


def draw(file: Path, pairs: list[BatchPair], results: list[BatchResult]) -> None:
    """The changes of each pair from above."""
    from matplotlib import pyplot

    from gmmjax.plotting import plot_changes

    figure, panels = pyplot.subplots(1, len(pairs), figsize=(12, 4.4), layout="constrained")
    for ax, pair, result in zip(panels, pairs, results, strict=True):
        plot_changes(result.changes(), pair.before, pair.after, ax=ax)
        ax.set_title(result.name)
    figure.savefig(file)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    main(parser.parse_args().plot)
