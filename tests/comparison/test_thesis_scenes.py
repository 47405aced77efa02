import numpy as np
import pytest

from gmmjax.mixtures import GaussianMixture
from tests.benchmarks.thesis_scenes import KINDS, compared, scenes, segments


@pytest.mark.slow
@pytest.mark.parametrize("method", ["greedy", "transport", "joint"])
def test_the_average_finds_what_changed_in_the_scenes_of_the_thesis(method):
    found = compared(scenes(KINDS["one"], [5000], points=300), method, restarts=16)
    assert found.averaged.f1 == 1
    assert found.averaged.point_f1 > 0.98
    assert found.averaged.f1 >= max(own.f1 for own in found.single) - 1e-12
    assert found.averaged.point_f1 >= np.mean([own.point_f1 for own in found.single]) - 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("method", ["transport", "joint"])
def test_the_average_finds_both_kinds_of_change(method):
    found = compared(scenes(KINDS["both"], [5000], points=300), method, restarts=16)
    assert found.averaged.f1 == 1
    assert found.averaged.point_f1 > 0.98


@pytest.mark.slow
def test_a_segment_is_a_component_of_which_most_changed():
    means = np.array([[0.0, 0], [10, 0], [20, 0]])
    mixture = GaussianMixture(np.full(3, 1 / 3), means, np.tile(np.eye(2), (3, 1, 1)), np.ones(3, bool))
    points = np.repeat(means, 4, axis=0)
    probability = np.array([1, 1, 1, 0.0] + [1, 0, 0, 0] + [0.9] * 4)
    assert segments(mixture, points, probability).tolist() == [0, 0, 0, -1] + [-1] * 4 + [2] * 4
