import types

import numpy as np
import pytest

from gmmjax.reporting.truth_rows import false_labels, truth_rows
from gmmjax.scenes import StorehouseSettings, storehouse


@pytest.fixture(scope="module")
def scene():
    return storehouse(0, StorehouseSettings(points=12_000, rays=20_000)).scene


def changes(labels):
    """As far as the comparison looks at them."""
    count = 1 + max(int(side.max()) for side in labels)
    return types.SimpleNamespace(labels_before=labels.before, labels_after=labels.after, items=[None] * count)


def test_what_was_found_has_its_labels_and_what_moved_its_motion(scene, as_users):
    found = changes(scene.truth.map(lambda truth: truth.copy()))
    rows = truth_rows(scene, found)
    assert [row.kind for row in rows] == list(scene.kinds)
    assert [row.labels for row in rows] == [(number,) for number in range(len(scene.kinds))]
    trolley = rows[4].motion
    assert trolley is not None
    np.testing.assert_allclose(trolley, (1.25, 35.0), atol=0.05)
    assert false_labels(scene, found) == []


def test_what_was_missed_and_what_is_false_is_told(scene, as_users):
    labels = scene.truth.map(lambda truth: np.where(truth == 5, -1, truth))
    unchanged = np.flatnonzero(scene.truth.before < 0)[:100]
    labels.before[unchanged] = 5
    found = changes(labels)
    assert truth_rows(scene, found)[5].labels == ()
    assert false_labels(scene, found) == [5]
