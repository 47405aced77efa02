"""Pairs that are small enough to be tuned on in a test."""

import jax
import numpy as np

from gmmjax.scenes import random_scene
from gmmjax.tuning import ScanPair, TuningSettings

# One shape for all tests of a folder.
POINTS = 100
SETTINGS = TuningSettings(steps=3, starts=2, pairs_per_step=2, max_points=450, learning_rate=0.5)


def gaussian_pair(seed, *, changed=True, labelled=True):
    """Five Gaussians before and after, of which one came and one went."""
    changes = {"appeared": 1, "disappeared": 1} if changed else {}
    scene = random_scene(jax.random.key(seed), points=POINTS, overlap="medium", **changes)
    truth = (np.asarray(scene.truth_before), np.asarray(scene.truth_after)) if labelled else (None, None)
    return ScanPair(f"seed {seed}", scene.before, scene.after, *truth)
