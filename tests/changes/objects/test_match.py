import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.objects.match import Compared, best_match, match_of
from gmmjax.changes.objects.same_object import MatchFacts, observability, principal_extents, shipped_model
from gmmjax.changes.objects.support_plane import support_planes
from gmmjax.geometry.local_surface import LocalSurface
from gmmjax.pair import Pair
from tests.changes.scanned_objects import box, motion, on_floor_and_shelf, placed

NOISE = 0.003
EXTENT = (0.4, 0.28, 0.22)


def matched(gone, new):
    parts = Pair(LocalSurface.of(gone), LocalSurface.of(new))
    return best_match(Compared(parts, parts, NOISE)), parts


def log_odds(gone, new):
    match, parts = matched(gone, new)
    return shipped_model()["free"].log_odds(MatchFacts.of(match, parts))


@pytest.mark.parametrize("faces", [(0, 1, 2, 3, 4), (0, 1, 2), (0, 2, 4)])
def test_one_object_is_known_again_from_other_sides(faces):
    new = placed(box(1, EXTENT, faces), motion(2.0, [0.8, -0.3, 0.1]))
    assert log_odds(box(0, EXTENT, (0, 1, 2)), new) > 0


@pytest.mark.parametrize("other", [(0.4, 0.28, 0.32), (0.3, 0.28, 0.22), (0.33, 0.33, 0.33)])
def test_another_object_is_not(other):
    assert log_odds(box(0, EXTENT), box(1, other) + 0.5) < 0


@pytest.mark.parametrize("seed", range(3))
def test_an_object_that_floats_is_laid_onto_itself_in_any_orientation(seed):
    true = motion(0, [0.5, 0.2, 0.3])
    true[:3, :3] = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    match, _ = matched(box(0, EXTENT), placed(box(1, EXTENT), true))
    assert min(match.there.covered, match.back.covered) > 0.9


def test_of_the_transforms_that_fit_the_smallest_rotation_is_taken():
    new = placed(box(1, EXTENT), motion(0.3, [0.8, -0.3, 0]))
    transform = matched(box(0, EXTENT), new)[0].transform
    assert Rotation.from_matrix(transform[:3, :3]).magnitude() == pytest.approx(0.3, abs=0.05)


def test_the_facts_of_a_match_have_no_unit():
    def facts(unit):
        parts = Pair(LocalSurface.of(unit * box(0, EXTENT)), LocalSurface.of(unit * (box(1, EXTENT) + 0.4)))
        match = match_of(Compared(parts, parts, unit * NOISE), motion(0, np.full(3, unit * 0.4)))
        return MatchFacts.of(match, parts)

    np.testing.assert_allclose(facts(1000.0), facts(1.0), rtol=1e-6, atol=1e-9)


def test_planes_and_strips_are_not_determined_by_their_normals():
    solid, plane = LocalSurface.of(box(0, EXTENT)), LocalSurface.of(box(0, EXTENT, faces=(2,)))
    assert (observability(plane)[:2] < observability(solid)[:2] / 2).all()
    np.testing.assert_allclose(principal_extents(plane.points)[:2], EXTENT[:2], rtol=0.1)


def test_an_object_on_a_support_plane_stays_upright():
    """Of one box the sides at +x and +y were seen, of the other one, on a shelf, those at -x and -y."""
    (gone, new), background = on_floor_and_shelf()
    parts = Pair(gone, new).map(LocalSurface.of)
    planes = Pair(*support_planes([*parts], background, NOISE))
    scenes = Pair(
        LocalSurface.of(np.concatenate([gone, background])), LocalSurface.of(np.concatenate([new, background]))
    )
    match = best_match(Compared(parts, scenes, NOISE, planes))
    assert match.upright and match.transform[2, 2] > 0.99
    assert placed(gone, match.transform)[:, 2].min() == pytest.approx(0.6, abs=0.03)
    assert not best_match(Compared(parts, scenes, NOISE, Pair(planes.before, None))).upright


def test_an_object_that_would_be_sunk_into_its_support_has_no_match():
    (gone, new), background = on_floor_and_shelf()
    parts = Pair(gone, new).map(LocalSurface.of)
    planes = Pair(*support_planes([*parts], background, NOISE))
    lower = planes.after._replace(height=planes.after.height - 0.05)
    match = best_match(Compared(parts, parts, NOISE, Pair(planes.before, lower)))
    assert match is None or match.there.covered < 0.6
