"""The labels that another checkout of gmmjax gives the points of some pairs, in a process of its own."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gmmjax.evaluation import LabelledPair
from gmmjax.pair import Pair
from tests.benchmarks.left_out import detect_there

# What is found with the poses unknown, and given; or why nothing is.
Found = dict[str, Pair[np.ndarray]] | str


def found_there(checkout: Path, pairs: Mapping[str, LabelledPair]) -> dict[str, Found]:
    """What `detect_changes` of another checkout finds, with its defaults.

    Args:
        checkout: its root.
        pairs: by name, with views.

    Returns:
        For each pair the labels by whether the poses are "unknown" or "given", or why there are none.

    Raises:
        RuntimeError: that gmmjax cannot be run.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, pair in pairs.items():
            np.savez(folder / f"{name}.pair.npz", **_arrays(pair))
        program = [sys.executable, "-P", detect_there.__file__, str(checkout.resolve()), str(folder)]
        environment = {**os.environ, "PYTHONPATH": str(checkout.resolve())}
        done = subprocess.run(program, cwd=folder, env=environment, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{checkout}: {done.stderr.strip()}")
        return {name: _found(folder, name) for name in pairs}


def _arrays(pair: LabelledPair) -> dict[str, np.ndarray]:
    arrays = {}
    for side, cloud in (("before", pair.before), ("after", pair.after)):
        assert cloud.views is not None
        arrays[f"points_{side}"] = cloud.points
        for name in ("poses", "field_of_view", "max_range"):
            arrays[f"{name}_{side}"] = np.asarray(getattr(cloud.views, name))
    return arrays


def _found(folder: Path, name: str) -> Found:
    failed = folder / f"{name}.failed.txt"
    if failed.exists():
        return failed.read_text()
    labels = np.load(folder / f"{name}.labels.npz")
    return {poses: Pair(labels[f"{poses}_before"], labels[f"{poses}_after"]) for poses in ("unknown", "given")}
