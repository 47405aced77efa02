"""How far off the registration leaves simulated surveys: millimetres at the centre of the room, and degrees."""

import argparse

import jax
import numpy as np

from gmmjax import DetectionConfig
from gmmjax.changes.registration import registered_pair
from gmmjax.scenes import laboratory_scene

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--rooms", type=int, default=4, help="surveys of each kind")
rooms = parser.parse_args().rooms
config = DetectionConfig()
for survey, level in (("panorama", "normal"), ("panorama", "hard"), ("frame", "normal")):
    errors = []
    for seed in range(8000, 8000 + rooms):
        scene = laboratory_scene(jax.random.key(seed), survey=survey, level=level)
        motion = registered_pair(scene.before, scene.after, config).registration.transform
        left = motion @ scene.misregistration
        centre = scene.before.mean(axis=0)
        angle = np.degrees(np.arccos(np.clip((np.trace(left[:3, :3]) - 1) / 2, -1, 1)))
        errors.append((1000 * np.linalg.norm(left[:3, :3] @ centre + left[:3, 3] - centre), angle))
    print(survey, level, np.round(errors, 2).tolist())
