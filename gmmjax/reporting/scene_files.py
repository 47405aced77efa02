"""Simulated scenes on disk: the two clouds, the truth of every point, and what they were drawn from."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.changes import NAMES
from gmmjax.clouds import FolderKind, atomic_write, check_output_folder, output_folder, write_ply, write_views
from gmmjax.mixtures import GaussianMixture
from gmmjax.scenes import ColoredScene, GaussianScene

SCHEMA_VERSION = 1
SCENE_FILE = "scene.json"
# Of either side; of a surveyed scene also what was unseen, changes that are not counted, and sensor views.
SIDE_FILES = ("{}.ply", "truth_{}.npy")
SURVEYED_FILES = (*SIDE_FILES, "unseen_{}.npy", "not_counted_{}.npy", "views_{}.json")
SCENE = FolderKind(
    "scene", SCENE_FILE, "mixture_before", tuple(name.format(side) for side in NAMES for name in SIDE_FILES)
)
SURVEYED = FolderKind(
    "scene", SCENE_FILE, "kinds", tuple(name.format(side) for side in NAMES for name in SURVEYED_FILES)
)


def check_scene_folder(folder: str | os.PathLike[str], *, overwrite: bool = False, surveyed: bool = False) -> None:
    """Raise an InputError unless `write_scene`, or `write_surveyed_scene`, could write there."""
    check_output_folder(folder, SURVEYED if surveyed else SCENE, overwrite=overwrite)


def write_scene(
    folder: str | os.PathLike[str],
    scene: GaussianScene,
    *,
    settings: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a scene, all files or none.

    `before.ply` and `after.ply`; `truth_before.npy` and `truth_after.npy` with -1 or the number of the change for each
    point; `scene.json` with the Gaussians that the points were drawn from.

    Args:
        folder: is made where needed; may be empty.
        scene: what to write.
        settings: how it was made, as plain values.
        overwrite: replace a previous scene.

    Returns:
        The folder.

    Raises:
        InputError: a folder that cannot be written; it is then as it was.
    """
    content = {"mixture_before": _to_dict(scene.mixture_before), "mixture_after": _to_dict(scene.mixture_after)}
    sides = zip(NAMES, (scene.before, scene.after), (scene.truth_before, scene.truth_after), strict=True)
    with output_folder(folder, SCENE, overwrite=overwrite) as staging:
        for side, points, truth in sides:
            cloud, truth_file = (staging / name.format(side) for name in SIDE_FILES)
            write_ply(cloud, points)
            _write_array(truth_file, truth)
        _write_content(staging, settings, content)
    return Path(folder)


def write_surveyed_scene(
    folder: str | os.PathLike[str],
    colored: ColoredScene,
    *,
    settings: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a surveyed scene, as `write_scene` does: a pair that `gmmjax evaluate pairs` and `gmmjax tune` read.

    `before.ply` and `after.ply` in colour; `views_*.json` with the poses of the sensor; `truth_*.npy`, `unseen_*.npy`
    and `not_counted_*.npy`; `scene.json` with the kinds and motions of the changes, and the true registration.
    """
    scene = colored.scene
    content = {
        "kinds": list(scene.kinds),
        "motions": {str(number): motion.tolist() for number, motion in scene.motions.items()},
        "registration": scene.registration.tolist(),
    }
    uncounted = scene.uncounted.map(lambda numbers: np.array(sorted(numbers), np.int64))
    sides = zip(NAMES, scene.clouds, colored.colors, scene.truth, scene.unseen, uncounted, scene.views, strict=True)
    with output_folder(folder, SURVEYED, overwrite=overwrite) as staging:
        for side, points, colors, *arrays, views in sides:
            cloud, *files, views_file = (staging / name.format(side) for name in SURVEYED_FILES)
            write_ply(cloud, points, colors=colors)
            for file, values in zip(files, arrays, strict=True):
                _write_array(file, values)
            write_views(views_file, views)
        _write_content(staging, settings, content)
    return Path(folder)


def _write_array(path: Path, values: np.ndarray) -> None:
    with atomic_write(path) as file:
        np.save(file, values, allow_pickle=False)


def _write_content(folder: Path, settings: Mapping[str, Any] | None, content: Mapping[str, Any]) -> None:
    """Write `scene.json`: how the scene was made, and what it was drawn from."""
    whole = {"schema_version": SCHEMA_VERSION, "settings": dict(settings or {}), **content}
    with atomic_write(folder / SCENE_FILE) as file:
        file.write(json.dumps(whole, indent=2, allow_nan=False).encode())


def _to_dict(mixture: GaussianMixture) -> dict[str, Any]:
    live = mixture.live_part()
    return {name: np.asarray(getattr(live, name)).tolist() for name in ("weights", "means", "covariances")}
