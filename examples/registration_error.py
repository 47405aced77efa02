"""How far off the registration leaves simulated surveys: millimetres at the centre of the room, and degrees."""

import argparse
from pathlib import Path

import jax
import numpy as np

from gmmjax.changes.align.alignment import aligned
from gmmjax.geometry.rigid import transformed
from gmmjax.pair import Pair
from gmmjax.scenes import laboratory_scene

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--rooms", type=int, default=4, help="surveys of each kind")
parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
options = parser.parse_args()
rooms, found = options.rooms, {}
for survey, level in (("panorama", "normal"), ("panorama", "hard"), ("frame", "normal")):
    errors = []
    for seed in range(8000, 8000 + rooms):
        scene = laboratory_scene(jax.random.key(seed), survey=survey, level=level)
        registration = aligned(Pair(scene.before, scene.after)).registration
        left = registration.transform @ scene.misregistration
        centre = scene.before.mean(axis=0)
        angle = np.degrees(np.arccos(np.clip((np.trace(left[:3, :3]) - 1) / 2, -1, 1)))
        errors.append((1000 * np.linalg.norm(transformed(centre[None], left) - centre), angle))
    found[f"{survey}, {level}"] = np.array(errors)
    print(survey, level, np.round(errors, 2).tolist())

if options.plot:
    from matplotlib import pyplot

    figure, ax = pyplot.subplots(figsize=(6, 4), layout="constrained")
    for marker, (name, errors) in zip("osv", found.items(), strict=True):
        ax.plot(*errors.T, marker, label=name)
    ax.set(xlim=0, ylim=0, xlabel="error at the centre of the room (mm)", ylabel="error of the rotation (degrees)")
    ax.grid(alpha=0.3)
    ax.legend()
    figure.savefig(options.plot)
