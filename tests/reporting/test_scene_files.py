import json

import jax
import numpy as np

from gmmjax.clouds import read_cloud
from gmmjax.reporting import write_scene
from gmmjax.scenes import random_scene


def test_a_scene_is_read_back(tmp_path):
    scene = random_scene(jax.random.key(0), start=3, appeared=1, disappeared=1, points=20)
    folder = write_scene(tmp_path / "scene", scene, settings={"seed": 0})
    np.testing.assert_array_equal(read_cloud(folder / "before.ply").points, scene.before)
    np.testing.assert_array_equal(read_cloud(folder / "after.ply").points, scene.after)
    np.testing.assert_array_equal(np.load(folder / "truth_before.npy", allow_pickle=False), scene.truth_before)
    np.testing.assert_array_equal(np.load(folder / "truth_after.npy", allow_pickle=False), scene.truth_after)
    content = json.loads((folder / "scene.json").read_text())
    np.testing.assert_array_equal(content["mixture_after"]["means"], scene.mixture_after.means)
    assert content["settings"] == {"seed": 0}
