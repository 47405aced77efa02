"""How far off the registration leaves simulated surveys: millimetres at the centre of the room, and degrees."""

import jax
import numpy as np

from gmmjax import DetectionConfig
from gmmjax.changes.registration import registered_pair
from gmmjax.scenes import laboratory_scene

config = DetectionConfig()
for survey, level in (("panorama", "normal"), ("panorama", "hard"), ("frame", "normal")):
    errors = []
    for seed in range(8000, 8004):
        scene = laboratory_scene(jax.random.key(seed), survey=survey, level=level)
        motion = registered_pair(scene.before, scene.after, config).registration.transform
        left = motion @ scene.misregistration
        centre = scene.before.mean(axis=0)
        angle = np.degrees(np.arccos(np.clip((np.trace(left[:3, :3]) - 1) / 2, -1, 1)))
        errors.append((1000 * np.linalg.norm(left[:3, :3] @ centre + left[:3, 3] - centre), angle))
    print(survey, level, np.round(errors, 2).tolist())
