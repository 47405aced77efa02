"""Scenes as files: one .npz each, for development."""

from pathlib import Path

import numpy as np

from tests.benchmarks.surveyor.surveys import SurveyedPair


def write_scene(path: Path, pair: SurveyedPair) -> None:
    """Writes points, truth, source, unseen (`_before` and `_after`) and the views' poses, angles and range."""
    arrays = {}
    for field in ("points", "truth", "source", "unseen"):
        for side, own in zip(("before", "after"), getattr(pair, field), strict=True):
            arrays[f"{field}_{side}"] = own
    for side, views in zip(("before", "after"), pair.views, strict=True):
        if views is None:
            continue
        arrays[f"poses_{side}"] = views.poses
        arrays[f"field_of_view_{side}"] = np.array(views.field_of_view)
        arrays[f"max_range_{side}"] = np.array(views.max_range)
    np.savez(path, **arrays)
