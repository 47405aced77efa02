"""Scenes as folders of files, as `gmmjax tune` reads them."""

from pathlib import Path

import numpy as np

from gmmjax.clouds import write_ply, write_views
from tests.benchmarks.surveyor.surveys import SurveyedPair


def write_scene(folder: Path, pair: SurveyedPair) -> None:
    """Writes both clouds, the truth, and the views where they are told; the folder is made."""
    folder.mkdir(parents=True)
    for side, points, truth, views in zip(("before", "after"), pair.points, pair.truth, pair.views, strict=True):
        write_ply(folder / f"{side}.ply", points)
        np.save(folder / f"truth_{side}.npy", truth)
        if views is not None:
            write_views(folder / f"views_{side}.json", views)
