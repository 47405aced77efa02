"""Simulated pairs of all kinds, with the arguments that they are detected with."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from gmmjax import DetectionConfig
from gmmjax.scenes import fixed_scene, laboratory_scene, random_scene, replaced_scene
from tests.benchmarks.displaced_scenes import hall, table


class Recorded(NamedTuple):
    """Two clouds and the other arguments of `detect_changes`."""

    before: np.ndarray
    after: np.ndarray
    arguments: dict[str, Any]


def _gaussians(scene: Any, **arguments: Any) -> Recorded:
    return Recorded(scene.before, scene.after, arguments)


@functools.cache
def _laboratory(seed: int, **options: Any) -> Any:
    return laboratory_scene(jax.random.key(seed), **options)


def _room(seed: int, *, views: bool = False, arguments: dict[str, Any] | None = None, **options: Any) -> Recorded:
    scene = _laboratory(seed, **options)
    # Every third point: a third of the time, and as many changes.
    before, after = scene.before[::3], scene.after[::3]
    poses = {"views_before": scene.views_before, "views_after": scene.views_after} if views else {}
    return Recorded(before, after, {**poses, **(arguments or {})})


def _displaced(pair: Recorded, degrees: float, translation: tuple[float, float, float]) -> Recorded:
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return pair._replace(after=pair.after @ rotation.T + translation)


def _config(**settings: Any) -> dict[str, Any]:
    return {"config": DetectionConfig(**settings)}


# An unchanged room, objects that came, went and moved, single frames: few, and detected in several ways.
CHANGED: dict[str, Any] = {"appeared": 1, "disappeared": 1, "moved": 1}
FRAME: dict[str, Any] = {"appeared": 1, "disappeared": 1, "survey": "frame"}

SCENES: dict[str, Callable[[], Recorded]] = {
    "gaussians": lambda: _gaussians(random_scene(jax.random.key(600), appeared=1, disappeared=1)),
    "gaussians, sparse": lambda: _gaussians(random_scene(jax.random.key(601), points=60)),
    "gaussians, displaced": lambda: _gaussians(random_scene(jax.random.key(602), points=400, shift=0.2)),
    "gaussians, one replaced": lambda: _gaussians(replaced_scene(jax.random.key(603), separation=1.0, points=400)),
    "gaussians, fewer after": lambda: _gaussians(random_scene(jax.random.key(604), points=400, density=0.4)),
    "gaussians, unchanged": lambda: _gaussians(random_scene(jax.random.key(605), appeared=0, points=400)),
    "gaussians, greedy": lambda: _gaussians(fixed_scene(jax.random.key(606), points=400), method="greedy", restarts=4),
    "gaussians, greedy for appeared": lambda: _gaussians(
        random_scene(jax.random.key(607), points=400), method="greedy", restarts=4, **_config(kinds="appeared")
    ),
    "gaussians, transport": lambda: _gaussians(
        random_scene(jax.random.key(608), points=400, disappeared=1), method="transport", restarts=4
    ),
    "room": lambda: _room(620, **CHANGED),
    "room, poses": lambda: _room(620, **CHANGED, views=True),
    "room, without evidence": lambda: _room(620, **CHANGED, arguments=_config(evidence=False)),
    "room, cropped": lambda: _room(620, **CHANGED, arguments=_config(crop=(-1.5, -1.5, 0.0, 1.5, 1.5, 2.0))),
    "room, rotated and moved": lambda: _displaced(_room(620, **CHANGED), 15, (0.2, -0.1, 0.05)),
    "room, not registered": lambda: _room(620, **CHANGED, arguments=_config(registration="never")),
    "room, another seed": lambda: _room(620, **CHANGED, arguments={"seed": 3, "restarts": 4}),
    "room, coarse": lambda: _room(620, **CHANGED, arguments=_config(voxel_size=0.03, kinds="disappeared")),
    "room, greedy": lambda: _room(620, **CHANGED, arguments={"method": "greedy", "restarts": 2}),
    "room, hard": lambda: _room(621, **CHANGED, level="hard"),
    "room, hard, poses": lambda: _room(621, **CHANGED, level="hard", views=True),
    "room, unchanged": lambda: _room(622, appeared=0),
    "frames": lambda: _room(623, **FRAME),
    "frames, poses": lambda: _room(623, **FRAME, views=True),
    "table": lambda: Recorded(*table(624), {}),
    "hall": lambda: Recorded(*hall(625, 20_000), {}),
}
