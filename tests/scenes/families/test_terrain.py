import numpy as np

from gmmjax.scenes import family_scene


def test_slopes_have_the_lengths_and_the_changes_of_slopes():
    kinds = set()
    for seed in range(3):
        scene = family_scene("terrain", seed)
        low, high = np.percentile(scene.clouds.before / scene.unit, [1, 99], axis=0)
        assert 15 < np.max(high - low) < 250
        kinds |= set(scene.kinds)
    assert kinds & {"appeared", "disappeared"}
