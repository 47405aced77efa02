"""Many pairs at once: in memory as they are done, and in a folder that a later run goes on with."""

import tempfile

import jax

from gmmjax import DetectionConfig
from gmmjax.batch import BatchPair, detect_many
from gmmjax.scenes import random_scene


def main() -> None:
    """Detects in three pairs, and then adds restarts to what was kept."""
    pairs = []
    for seed in range(3):
        scene = random_scene(jax.random.key(seed), appeared=seed % 2)
        # Paths of files are taken, too, and read by the workers.
        pairs.append(BatchPair(f"scene {seed}", scene.before, scene.after))

    for result in sorted(detect_many(pairs, config=DetectionConfig(restarts=2)), key=lambda result: result.name):
        print(result.name, f"{result.pair.changes} changes", [change.kind for change in result.changes()])

    with tempfile.TemporaryDirectory() as folder:
        for restarts in (2, 4):
            results = list(detect_many(pairs, out=folder, config=DetectionConfig(restarts=restarts)))
            reused = sum(result.reused for result in results)
            print(f"{restarts} restarts: {len(results)} pairs, {reused} of them from before")


if __name__ == "__main__":
    main()
