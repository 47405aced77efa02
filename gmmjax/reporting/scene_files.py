"""Simulated scenes on disk: the two clouds, the truth of every point, and the Gaussians."""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds import FolderKind, atomic_write, check_output_folder, output_folder, write_ply
from gmmjax.mixtures import GaussianMixture
from gmmjax.scenes import GaussianScene

SCHEMA_VERSION = 1
SCENE_FILE = "scene.json"
BEFORE_FILE = "before.ply"
AFTER_FILE = "after.ply"
TRUTH_BEFORE_FILE = "truth_before.npy"
TRUTH_AFTER_FILE = "truth_after.npy"
SCENE = FolderKind(
    "scene", SCENE_FILE, "mixture_before", (BEFORE_FILE, AFTER_FILE, TRUTH_BEFORE_FILE, TRUTH_AFTER_FILE)
)


def check_scene_folder(folder: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Whether `write_scene` could write there.

    Raises:
        InputError: the folder is a file, holds something else, holds a scene and not `overwrite`, or cannot be written.
    """
    check_output_folder(folder, SCENE, overwrite=overwrite)


def write_scene(
    folder: str | os.PathLike[str],
    scene: GaussianScene,
    *,
    settings: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> Path:
    """Writes a scene, all files or none.

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


def _to_dict(mixture: GaussianMixture) -> dict[str, Any]:
    live = mixture.live_part()
    return {name: np.asarray(getattr(live, name)).tolist() for name in ("weights", "means", "covariances")}
