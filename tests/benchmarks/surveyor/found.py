"""Which changes of a large pair are reported, and which reported ones are none, by the boxes in `changes.csv`."""

import csv
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from tests.benchmarks.surveyor.surveys import SurveyedPair


def found_in_large(path: Path, pair: SurveyedPair, steps: np.ndarray, near: float = 1.0) -> str:
    """How many of the changes that can be judged are reported, and how many of the reported ones are none.

    Args:
        path: of `changes.csv`.
        pair: the scene, with its truth.
        steps: [copies, 3], from the scene to each of its copies in the large pair, metres.
        near: from the centre of a reported box to the nearest point of what changed, at most, metres.
    """
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    centres = np.array([[float(row[f"centre_{axis}"]) for axis in "xyz"] for row in rows]).reshape(-1, 3)
    places = [
        cKDTree(points[truth == number] + step)
        for points, truth in zip(pair.points, pair.truth, strict=True)
        for number in np.unique(truth[truth >= 0])
        for step in steps
    ]
    in_place = np.array([place.query(centres)[0] <= near for place in places]).reshape(len(places), len(centres))
    reported, none = in_place.any(axis=1).sum(), (~in_place.any(axis=0)).sum()
    return f"{reported} of {len(places)} changes reported; {none} of {len(centres)} reported are none"
