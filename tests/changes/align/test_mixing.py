import numpy as np
import pytest

from gmmjax.changes.align.mixing import Mixing
from gmmjax.geometry import rigid_transform
from gmmjax.pair import Pair

GIVEN = np.eye(4)


def blob(seed, points=2000):
    return np.random.default_rng(seed).normal(size=(points, 3))


@pytest.mark.parametrize("points", [2000, 500])
def test_two_samples_of_one_density_are_mixed_whatever_their_numbers(points):
    mixing = Mixing.of(Pair(blob(0), blob(1, points)))
    assert mixing.share(GIVEN) > 0.9 and mixing.confidence() == 1


def test_what_changed_is_not_mixed():
    gone = blob(0)[:500] + 20
    assert Mixing.of(Pair(np.concatenate([blob(1), gone]), blob(2))).share(GIVEN) == pytest.approx(0.8, abs=0.1)


def test_a_displaced_sample_is_mixed_better_elsewhere():
    back = rigid_transform(translation=np.array([-1.0, 0, 0]))
    mixing = Mixing.of(Pair(blob(0), blob(1) + np.array([1.0, 0, 0])))
    assert mixing.better(back, GIVEN) > 4 > -4 > mixing.better(GIVEN, back)
    assert mixing.confidence() == 0


def test_equal_points_are_mixed():
    assert Mixing.of(Pair(blob(0), blob(0))).share(GIVEN) == 1
    assert Mixing.of(Pair(np.repeat(blob(0), 3, axis=0), blob(0))).share(GIVEN) == 1
