import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.change_surface import ChangeSurface
from gmmjax.geometry import LocalSurface
from gmmjax.pair import Pair

UP, NOTHING = np.array([0.0, 0.0, 1.0]), np.empty((0, 3))


def surface(points, outward):
    return ChangeSurface(Pair(NOTHING, points), Pair(NOTHING, points), NOTHING, LocalSurface.of(points), outward)


@pytest.mark.parametrize("seed", range(3))
def test_the_axes_lie_in_the_plane_of_a_change_and_turn_with_it(seed):
    random = np.random.default_rng(seed)
    # Its longer tail is along x.
    points = np.stack([random.exponential(2.0, 400), random.normal(0, 0.2, 400), random.normal(0, 0.01, 400)], axis=1)
    turn = Rotation.random(rng=random).as_matrix()
    along, across = axes = surface(points, UP).across()
    assert along[0] > 0.99 and along[2] == pytest.approx(0)
    np.testing.assert_allclose(np.cross(along, across), UP, atol=1e-9)
    np.testing.assert_allclose(surface(points @ turn.T, turn @ UP).across(), axes @ turn.T, atol=1e-9)
