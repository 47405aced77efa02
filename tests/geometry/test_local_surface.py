import numpy as np
import pytest

from gmmjax.geometry.local_surface import LocalSurface, ScanLineSettings, evenly_chosen, local_planes
from tests.changes.scanned_objects import motion, placed


def slope(seed=0, count=3000, noise=0.002):
    """A plane x + z = 1 with some noise across it."""
    random = np.random.default_rng(seed)
    x, y, across = *random.uniform(0, 1, (2, count)), noise * random.standard_normal(count)
    return np.stack([x + across, y, 1 - x + across], axis=1)


def test_planes_and_means_are_those_of_the_surface():
    surface = LocalSurface.of(slope())
    assert np.median(np.abs(surface.normals @ [2**-0.5, 0, 2**-0.5])) > 0.99
    means = surface.means(np.arange(len(surface)))
    off = np.abs(means[:, 0] + means[:, 2] - 1)
    single = np.abs(surface.points[:, 0] + surface.points[:, 2] - 1)
    assert np.median(off) < 0.5 * np.median(single)


def test_a_moved_surface_is_that_of_the_moved_points():
    way = motion(0.7, [1, -2, 3])
    moved, again = LocalSurface.of(slope()).moved(way), LocalSurface.of(placed(slope(), way))
    np.testing.assert_allclose(moved.points, again.points, atol=1e-12)
    np.testing.assert_allclose(moved.centres, again.centres, atol=1e-9)
    np.testing.assert_allclose(np.abs((moved.normals * again.normals).sum(axis=1)), 1, atol=1e-6)
    np.testing.assert_allclose(moved.variances, again.variances, atol=1e-12)
    places = again.points[:50] + 0.001
    np.testing.assert_array_equal(moved.nearest(places), again.nearest(places))


def test_heights_are_along_the_normal():
    surface = LocalSurface.of(slope())
    chosen = np.arange(len(surface))
    inside = surface.heights(surface.points, chosen)
    across = (surface.points[:, 0] + surface.points[:, 2] - 1) / np.sqrt(2)
    assert np.median(np.abs(np.abs(inside.above) - np.abs(across))) < 0.001
    raised = surface.heights(surface.points + 0.5 * surface.normals, chosen)
    np.testing.assert_allclose(raised.above - inside.above, 0.5)
    np.testing.assert_allclose(raised.beside, inside.beside, atol=1e-6)


def test_normals_are_uncertain_where_there_is_no_surface():
    chosen = np.arange(3000)
    crowd = LocalSurface.of(np.random.default_rng(0).uniform(0, 1, (3000, 3)))
    assert np.median(LocalSurface.of(slope()).tilts(chosen)) < 0.05
    assert np.median(crowd.tilts(chosen)) > 0.3 and crowd.tilts(chosen).max() <= 1


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_few_points_have_a_surface_too(count):
    surface = LocalSurface.of(slope(count=count))
    assert surface.neighbours.shape == (count, count)
    assert np.isfinite(surface.means(np.arange(count))).all() and np.isfinite(surface.normals).all()


def lines(apart, along=0.05, noise=0.001):
    """A floor along the lines of a scanner far away, which are farther from each other than points on them."""
    random = np.random.default_rng(4)
    x, y = np.meshgrid(along * np.arange(400), apart * np.arange(25))
    jitter = along * random.random(25)[:, None]
    return np.stack([x + jitter, y, noise * random.standard_normal(x.shape)], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("apart", [0.2, 0.6])
def test_the_plane_of_a_floor_in_lines_goes_through_several_of_them(apart):
    floor = lines(apart)
    surface, by_rows = LocalSurface.of(floor), LocalSurface.of(floor, rows=ScanLineSettings(neighbours=0))
    inside = np.flatnonzero((np.abs(floor[:, 0] - 10) < 8) & (np.abs(floor[:, 1] - 12 * apart) < 8 * apart))
    assert np.abs(surface.normals[inside, 2]).min() > 0.999
    assert not surface.on_scan_lines(inside, 0.2).any()
    # The spacing is that of as many points spread evenly.
    assert np.median(surface.spacing(inside)) == pytest.approx(np.sqrt(0.05 * apart), rel=0.15)
    if apart > 0.5:
        assert (surface.counts[inside] == 64).all() and by_rows.on_scan_lines(inside, 0.2).all()
        assert np.median(np.abs(by_rows.normals[inside, 2])) < 0.99


def test_a_line_beside_which_there_is_nothing_stays_a_row():
    """A cable, and the lines of a post and of a beam on it, which no face goes through."""
    along = 0.02 * np.arange(200)
    cable = np.column_stack([along, 0 * along, 3 + 0 * along])
    post = np.column_stack([0 * along + 9, 0 * along, along])
    beam = np.column_stack([9 + along, 0 * along, 0 * along + 4])
    surface = LocalSurface.of(np.concatenate([cable, post, beam, lines(0.6) - [0, 30, 0]]))
    assert (surface.counts[:600] == 16).all() and surface.on_scan_lines(np.arange(600), 0.2).mean() > 0.9


def test_chosen_evenly():
    np.testing.assert_array_equal(evenly_chosen(5, 9), np.arange(5))
    np.testing.assert_array_equal(evenly_chosen(9, 3), [0, 4, 8])


def test_planes_of_exact_planes():
    random = np.random.default_rng(11)
    normal = np.array([0.6, 0.0, 0.8])
    flat = random.normal(size=(5, 20, 3))
    flat -= np.einsum("nki,i->nk", flat, normal)[..., None] * normal - 2 * normal
    centres, normals, variances = local_planes(flat)
    np.testing.assert_allclose(np.abs(normals @ normal), 1)
    np.testing.assert_allclose(centres @ normal, 2)
    np.testing.assert_allclose(variances[:, 0], 0, atol=1e-12)


def test_planes_are_the_same_whatever_is_computed_at_a_time():
    points = np.random.default_rng(8).uniform(0, 1, (501, 3))
    whole, parts = LocalSurface.of(points), LocalSurface.of(points, chunk=100)
    for one, other in ((whole.normals, parts.normals), (whole.centres, parts.centres)):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(whole.variances, parts.variances)
