"""The points in cylinders: the kernel, the search with SciPy's tree, and every point compared with every cylinder."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax import native
from gmmjax.changes import cylinders as module
from gmmjax.changes.cylinders import Cylinders, projections
from gmmjax.pair import Pair

SEARCHES = ["kernel", "plain"]


@pytest.fixture(params=SEARCHES)
def search(request, monkeypatch):
    return use(request.param, monkeypatch)


def use(search, monkeypatch):
    if search == "plain":
        monkeypatch.setattr(native, "host_kernels", lambda: None)
    elif native.host_kernels() is None:
        pytest.skip("the kernels were not built")


def example(points, cylinders, seed, offset=0.0, slope=1.0):
    """Clouds on a bent surface, and cylinders of all kinds of shapes near it."""
    random = np.random.default_rng(seed)

    def surface(count):
        places = random.uniform(-1, 1, (count, 3))
        places[:, 2] = slope * 0.1 * places[:, 2] + 0.3 * places[:, 0] ** 2
        return places + offset

    axes = random.standard_normal((cylinders, 3))
    # Some along the axes, where the boxes of the tree are touched at their faces.
    axes[::3] = np.eye(3)[random.integers(0, 3, len(axes[::3]))]
    shapes = np.exp(random.uniform(np.log(0.02), np.log(0.7), (2, cylinders)))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return Pair(surface(points), surface(points // 2)), Cylinders(surface(cylinders), axes, *shapes)


def every_point(points, cylinders):
    """Count, mean and variance by definition."""
    for centre, axis, radius, half_length in zip(*dataclasses.astuple(cylinders), strict=True):
        along = (points - centre) @ axis
        from_axis = np.linalg.norm(np.cross(points - centre, axis), axis=1)
        inside = along[(np.abs(along) <= half_length) & (from_axis <= radius)]
        yield (
            len(inside),
            inside.mean() if len(inside) else np.nan,
            inside.var(ddof=1) if len(inside) > 1 else np.nan,
        )


def assert_same(found, expected):
    np.testing.assert_array_equal(found.count, expected.count)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.variance, expected.variance, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("points", [0, 1, 2, 17, 128, 129, 3000])
@pytest.mark.parametrize("offset", [0.0, 4e6])
def test_by_definition(search, points, offset):
    clouds, cylinders = example(points, 60, seed=points, offset=offset)
    for own, found in zip(clouds, projections(clouds, cylinders), strict=True):
        expected = module.Projections(*(np.array(column) for column in zip(*every_point(own, cylinders), strict=True)))
        assert_same(found, expected)
        assert points < 1000 or ((found.count > 10).any() and (found.count < 2).any())


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), points=st.integers(1, 400), slope=st.sampled_from([0.0, 1.0]))
def test_the_kernel_is_as_the_plain_search(seed, points, slope):
    if native.host_kernels() is None:
        pytest.skip("the kernels were not built")
    clouds, cylinders = example(points, 30, seed, slope=slope)
    found = projections(clouds, cylinders)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native, "host_kernels", lambda: None)
        expected = projections(clouds, cylinders)
    for one, other in zip(found, expected, strict=True):
        assert_same(one, other)


def test_equal_points_are_all_counted(search):
    points = np.repeat([[1.0, 2.0, 3.0], [1.0, 2.0, 3.5]], 100, axis=0)
    ones = np.ones(1)
    found = projections(Pair(points, points[:100]), Cylinders(points[:1], np.array([[0.0, 0, 1]]), ones, ones))
    assert (found.before.count[0], found.after.count[0]) == (200, 100)
    assert found.before.mean[0] == 0.25 and found.after.mean[0] == found.after.variance[0] == 0


def test_far_outliers_hide_nothing(search):
    clouds, cylinders = example(500, 20, seed=3)
    outliers = np.array([[1e9, 0, 0], [0, -1e12, 0]])
    for found, expected in zip(
        projections(clouds.map(lambda own: np.r_[own, outliers]), cylinders),
        projections(clouds, cylinders),
        strict=True,
    ):
        np.testing.assert_array_equal(found.count, expected.count)


def test_the_same_bit_for_bit_by_any_number_of_threads(search, monkeypatch):
    clouds, cylinders = example(300, 40, seed=5)
    # So slender that they are searched in several parts.
    slender = dataclasses.replace(cylinders, radii=np.full(40, 1e-3), half_lengths=np.full(40, 1.0))
    assert len(list(module._parts(slender))) > 1
    by = []
    for cores in (1, 3):
        monkeypatch.setattr(module, "available_cores", lambda cores=cores: cores)
        by.append(projections(clouds, slender))
    for one, other in zip(*by, strict=True):
        for name in ("count", "mean", "variance"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_cylinder_is_the_same_whatever_is_computed_beside_it(search):
    clouds, cylinders = example(1000, 50, seed=7)
    all_of_them, some = projections(clouds, cylinders), projections(clouds, cylinders.part(slice(10, 20)))
    for one, other in zip(all_of_them, some, strict=True):
        np.testing.assert_array_equal(one.mean[10:20], other.mean)


def test_no_cylinders(search):
    clouds, cylinders = example(100, 3, seed=0)
    assert len(projections(clouds, cylinders.part(slice(0))).before.count) == 0


def test_kernels_take_no_arrays_of_other_lengths():
    kernels = native.host_kernels()
    if kernels is None:
        pytest.skip("the kernels were not built")
    with pytest.raises(ValueError, match="points"):
        kernels.packed_points(np.zeros((0, 3)))
    tree = kernels.packed_points(np.zeros((4, 3)))
    numbers = [np.zeros(2) for _ in range(5)]
    with pytest.raises(ValueError, match="one length"):
        kernels.projections(tree, np.zeros((2, 3)), np.zeros((1, 3)), *numbers)
