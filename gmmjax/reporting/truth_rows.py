"""The true changes of a simulated scene, beside those that were found."""

from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gmmjax.changes import Changes, Kind
from gmmjax.geometry import transformed
from gmmjax.pair import Pair, each
from gmmjax.scenes import SurveyedScene


class TruthRow(NamedTuple):
    """A true change.

    Attributes:
        kind: of the change.
        points: in both clouds together.
        centre: mean of its points in the frame of the before cloud; of what moved, where it was before.
        motion: by how much it moved and turned, in the unit of the clouds and degrees; None: it did not move.
        labels: of the changes that at least half of its points belong to, of either cloud.
    """

    kind: Kind
    points: int
    centre: Float[np.ndarray, "3"]
    motion: tuple[float, float] | None
    labels: tuple[int, ...]


def truth_rows(scene: SurveyedScene, changes: Changes) -> list[TruthRow]:
    """List the true changes that have points in a cloud, in the order of their numbers."""
    scanned = np.unique(np.concatenate(list(scene.truth)))
    return [
        _row(scene, changes, number, cast(Kind, kind)) for number, kind in enumerate(scene.kinds) if number in scanned
    ]


def false_labels(scene: SurveyedScene, changes: Changes) -> list[int]:
    """List the labels of reported changes of whose points less than half changed in truth."""
    true, reported = scene.truth, Pair(changes.labels_before, changes.labels_after)
    found = []
    for label in range(len(changes.items)):
        changed = [(truth >= 0)[labels == label] for truth, labels in zip(true, reported, strict=True)]
        if np.concatenate(changed).mean() < 0.5:
            found.append(label)
    return found


def _row(scene: SurveyedScene, changes: Changes, number: int, kind: Kind) -> TruthRow:
    places = Pair(scene.clouds.before, transformed(scene.clouds.after, scene.registration))
    own = each(lambda points, truth: points[truth == number], places, scene.truth)
    labels = each(
        lambda reported, truth: _most(reported[truth == number]),
        Pair(changes.labels_before, changes.labels_after),
        scene.truth,
    )
    centres = own.map(lambda points: points.mean(axis=0) if len(points) else None)
    centre = centres.after if centres.before is None else centres.before
    assert centre is not None, "a change has points in one of the clouds"
    return TruthRow(
        kind,
        sum(len(points) for points in own),
        centre,
        _motion(scene, number, centre) if kind == "moved" else None,
        tuple(label for label in dict.fromkeys(labels) if label is not None),
    )


def _most(labels: np.ndarray) -> int | None:
    """Return the label that at least half of these points have; None: they have none, or there are no points."""
    if not len(labels) or (labels >= 0).mean() < 0.5:
        return None
    numbers, counts = np.unique(labels[labels >= 0], return_counts=True)
    return int(numbers[np.argmax(counts)])


def _motion(scene: SurveyedScene, number: int, centre: np.ndarray) -> tuple[float, float]:
    motion = scene.registration @ scene.motions[number]
    distance = float(np.linalg.norm(transformed(centre[None], motion)[0] - centre))
    return distance, float(np.degrees(Rotation.from_matrix(motion[:3, :3]).magnitude()))
