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


def test_the_ground_below_a_deposit_changed_with_it():
    scene = family_scene("terrain", 9)
    assert scene.kinds == ("appeared",)
    for truth, unseen in zip(scene.truth, scene.unseen, strict=True):
        assert (truth == 0).sum() > 80
        assert unseen[truth == 0].mean() < 0.2
