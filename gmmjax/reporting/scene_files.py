"""Simulated scenes on disk: the two clouds, the truth of every point, and what they were drawn from."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds import FolderKind, atomic_write, check_output_folder, output_folder, write_ply, write_views
from gmmjax.mixtures import GaussianMixture
from gmmjax.pair import Pair
from gmmjax.scenes import ColoredScene, GaussianScene

SCHEMA_VERSION = 1
SCENE_FILE = "scene.json"
BEFORE_FILE = "before.ply"
AFTER_FILE = "after.ply"
TRUTH_BEFORE_FILE = "truth_before.npy"
TRUTH_AFTER_FILE = "truth_after.npy"
SCENE = FolderKind(
    "scene", SCENE_FILE, "mixture_before", (BEFORE_FILE, AFTER_FILE, TRUTH_BEFORE_FILE, TRUTH_AFTER_FILE)
)
# What there is of either side of a surveyed scene: cloud, truth, what was unseen, uncounted changes, sensor views.
SIDE_FILES = ("{}.ply", "truth_{}.npy", "unseen_{}.npy", "not_counted_{}.npy", "views_{}.json")
SIDES = Pair("before", "after")
SURVEYED = FolderKind("scene", SCENE_FILE, "kinds", tuple(name.format(side) for side in SIDES for name in SIDE_FILES))


def check_scene_folder(folder: str | os.PathLike[str], *, overwrite: bool = False, surveyed: bool = False) -> None:
    """Whether `write_scene`, or `write_surveyed_scene`, could write there.

    Raises:
        InputError: the folder is a file, holds something else, holds a scene and not `overwrite`, or cannot be written.
    """
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
    content = {
        "schema_version": SCHEMA_VERSION,
        "settings": dict(settings or {}),
        "mixture_before": _to_dict(scene.mixture_before),
        "mixture_after": _to_dict(scene.mixture_after),
    }
    with output_folder(folder, SCENE, overwrite=overwrite) as staging:
        write_ply(staging / BEFORE_FILE, scene.before)
        write_ply(staging / AFTER_FILE, scene.after)
        for name, truth in ((TRUTH_BEFORE_FILE, scene.truth_before), (TRUTH_AFTER_FILE, scene.truth_after)):
            with atomic_write(staging / name) as file:
                np.save(file, truth, allow_pickle=False)
        with atomic_write(staging / SCENE_FILE) as file:
            file.write(json.dumps(content, indent=2, allow_nan=False).encode())
    return Path(folder)


def write_surveyed_scene(
    folder: str | os.PathLike[str],
    colored: ColoredScene,
    *,
    settings: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a surveyed scene, all files or none, as a pair that `gmmjax evaluate pairs` and `gmmjax tune` read.

    `before.ply` and `after.ply` in colour; `views_*.json` with the poses of the sensor; `truth_*.npy`, `unseen_*.npy`
    and `not_counted_*.npy`; `scene.json` with the kinds and motions of the changes, and the true registration.

    Args:
        folder: is made where needed; may be empty.
        colored: what to write.
        settings: how it was made, as plain values.
        overwrite: replace a previous scene.

    Returns:
        The folder.

    Raises:
        InputError: a folder that cannot be written; it is then as it was.
    """
    scene = colored.scene
    content = {
        "schema_version": SCHEMA_VERSION,
        "settings": dict(settings or {}),
        "kinds": list(scene.kinds),
        "motions": {str(number): motion.tolist() for number, motion in scene.motions.items()},
        "registration": scene.registration.tolist(),
    }
    uncounted = scene.uncounted.map(lambda numbers: np.array(sorted(numbers), np.int64))
    sides = zip(SIDES, scene.clouds, colored.colors, scene.truth, scene.unseen, uncounted, scene.views, strict=True)
    with output_folder(folder, SURVEYED, overwrite=overwrite) as staging:
        for side, points, colors, *arrays, views in sides:
            cloud, *names, views_file = (staging / name.format(side) for name in SIDE_FILES)
            write_ply(cloud, points, colors=colors)
            for name, values in zip(names, arrays, strict=True):
                with atomic_write(name) as file:
                    np.save(file, values, allow_pickle=False)
            write_views(views_file, views)
        with atomic_write(staging / SCENE_FILE) as file:
            file.write(json.dumps(content, indent=2, allow_nan=False).encode())
    return Path(folder)


def _to_dict(mixture: GaussianMixture) -> dict[str, Any]:
    live = mixture.live_part()
    return {name: np.asarray(getattr(live, name)).tolist() for name in ("weights", "means", "covariances")}
