import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.changes import Box
from tests.mixtures.examples import random_rotation


@given(seed=st.integers(0, 10**6), count=st.integers(1, 40))
def test_box_holds_all_points_tightly(seed, count):
    points = np.random.default_rng(seed).normal(size=(count, 3)) * np.array([3, 1, 0.2]) + 1e3
    box = Box.around(points)
    inside = (points - box.centre) @ box.rotation
    assert (np.abs(inside) <= box.extent / 2 + 1e-9).all()
    np.testing.assert_allclose(2 * np.abs(inside).max(axis=0), box.extent, atol=1e-9)
    assert (np.diff(box.extent) <= 1e-12).all()
    np.testing.assert_allclose(np.linalg.det(box.rotation), 1)
    np.testing.assert_allclose(box.corners().mean(axis=0), box.centre)


def test_box_turns_with_its_points():
    points, rotation = np.random.default_rng(0).normal(size=(200, 3)) * np.array([3, 1, 0.2]), random_rotation()
    box, turned = Box.around(points), Box.around(points @ rotation.T)
    np.testing.assert_allclose(turned.extent, box.extent)
    np.testing.assert_allclose(turned.centre, rotation @ box.centre, atol=1e-9)
