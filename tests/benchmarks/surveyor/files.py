"""Scenes as folders of files, as `gmmjax tune` and `gmmjax evaluate` read them."""

from pathlib import Path

import numpy as np

from gmmjax.clouds import write_ply, write_views
from tests.benchmarks.surveyor.solids import UNCHANGED
from tests.benchmarks.surveyor.surveys import SurveyedPair


def write_scene(folder: Path, pair: SurveyedPair) -> None:
    """Writes both clouds, the truth, and the views where they are told; the folder is made.

    What nobody can judge is unchanged there, or not seen by the other survey.
    """
    folder.mkdir(parents=True)
    sides = zip(("before", "after"), pair.points, pair.truth, pair.unseen, pair.views, strict=True)
    for side, points, truth, unseen, views in sides:
        write_ply(folder / f"{side}.ply", points)
        np.save(folder / f"truth_{side}.npy", np.maximum(truth, UNCHANGED))
        np.save(folder / f"unseen_{side}.npy", unseen)
        if views is not None:
            write_views(folder / f"views_{side}.json", views)
