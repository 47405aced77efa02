"""The points in cylinders: the kernel, the search with SciPy's tree, and every point compared with every cylinder."""

import dataclasses
import functools
import os
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax import native
from gmmjax.changes import cylinders as module
from gmmjax.changes.cylinders import Cylinders, Projections, projections


@pytest.fixture(params=["kernel", "plain"])
def search(request, monkeypatch):
    if request.param == "plain":
        monkeypatch.setattr(native, "host_kernels", lambda: None)
    elif native.host_kernels() is None:
        pytest.skip("the kernels were not built")


def example(points, cylinders, seed, offset=0.0, slope=1.0):
    """A cloud on a bent surface, and cylinders of all kinds of shapes near it."""
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
    return surface(points), Cylinders(surface(cylinders), axes, *shapes)


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
    cloud, cylinders = example(points, 60, seed=points, offset=offset)
    found = projections(cloud, cylinders)
    assert_same(found, Projections(*(np.array(column) for column in zip(*every_point(cloud, cylinders), strict=True))))
    if points == 3000:
        assert (found.count > 10).any() and (found.count < 2).any()


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), points=st.integers(1, 400), slope=st.sampled_from([0.0, 1.0]))
def test_the_kernel_is_as_the_plain_search(seed, points, slope):
    if native.host_kernels() is None:
        pytest.skip("the kernels were not built")
    cloud, cylinders = example(points, 30, seed, slope=slope)
    found = projections(cloud, cylinders)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native, "host_kernels", lambda: None)
        assert_same(found, projections(cloud, cylinders))


def test_equal_points_are_all_counted(search):
    points = np.repeat([[1.0, 2.0, 3.0], [1.0, 2.0, 3.5]], 100, axis=0)
    one = np.ones(1)
    found = projections(points, Cylinders(points[:1], np.array([[0.0, 0, 1]]), one, one))
    assert found.count[0] == 200 and found.mean[0] == 0.25
    found = projections(points[:100], Cylinders(points[:1], np.array([[0.0, 0, 1]]), one, one))
    assert found.count[0] == 100 and found.mean[0] == found.variance[0] == 0


def test_far_outliers_hide_nothing(search):
    cloud, cylinders = example(500, 20, seed=3)
    with_outliers = projections(np.r_[cloud, [[1e9, 0, 0], [0, -1e12, 0]]], cylinders)
    np.testing.assert_array_equal(with_outliers.count, projections(cloud, cylinders).count)


def test_the_same_bit_for_bit_by_any_number_of_threads(search, monkeypatch):
    cloud, cylinders = example(300, 40, seed=5)
    # So slender that they are searched in several parts.
    slender = dataclasses.replace(cylinders, radii=np.full(40, 1e-3), half_lengths=np.full(40, 1.0))
    assert len(module._parts_that_fit(slender)) > 1
    monkeypatch.setattr(module, "_parts_for", functools.partial(module._parts_for, fewest=10))
    by = []
    for cores in (1, 3):
        monkeypatch.setattr(module, "available_cores", lambda cores=cores: cores)
        by.append(projections(cloud, slender))
    for one, other in zip(*map(dataclasses.astuple, by), strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_cylinder_is_the_same_whatever_is_computed_beside_it(search):
    cloud, cylinders = example(1000, 50, seed=7)
    some = projections(cloud, cylinders.part(slice(10, 20)))
    np.testing.assert_array_equal(projections(cloud, cylinders).mean[10:20], some.mean)


def test_no_cylinders(search):
    cloud, cylinders = example(100, 3, seed=0)
    assert len(projections(cloud, cylinders.part(slice(0))).count) == 0


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


WITH_NARROWER_VECTORS = """
import importlib.util, sys
import numpy as np

spec = importlib.util.spec_from_file_location("_kernels", sys.argv[1])
kernels = importlib.util.module_from_spec(spec)
spec.loader.exec_module(kernels)
with np.load(sys.argv[2]) as given:
    points, *cylinders = (given[name] for name in given.files)
count = len(cylinders[0])
found = np.zeros(count, np.int64), np.zeros(count), np.zeros(count)
kernels.projections(kernels.packed_points(points), *cylinders, *found)
np.savez(sys.argv[2], *found)
"""


@pytest.mark.parametrize("instructions", ["baseline", "avx2"])
def test_narrower_vectors_find_the_same(instructions, tmp_path):
    kernels = native.host_kernels()
    if kernels is None:
        pytest.skip("the kernels were not built")
    cloud, cylinders = example(500, 40, seed=11)
    file, shapes = tmp_path / "arrays.npz", [getattr(cylinders, own.name) for own in dataclasses.fields(cylinders)]
    np.savez(file, cloud, *shapes)
    command = [sys.executable, "-c", WITH_NARROWER_VECTORS, kernels.__file__, str(file)]
    subprocess.run(command, check=True, env=os.environ | {"GMMJAX_INSTRUCTIONS": instructions})
    with np.load(file) as arrays:
        assert_same(Projections(*(arrays[name] for name in arrays.files)), projections(cloud, cylinders))


@pytest.mark.slow
def test_the_plain_search_bounds_its_memory_beside_a_scanner(monkeypatch):
    """Millions of points are in a thousand cylinders that are hardly apart: a few hundred bytes each."""
    monkeypatch.setattr(native, "host_kernels", lambda: None)
    points = np.random.default_rng(0).uniform(-1, 1, (3000, 3))
    axes = np.tile([0.0, 0.0, 1.0], (1000, 1))
    around = Cylinders(np.zeros((1000, 3)), axes, np.full(1000, 2.0), np.full(1000, 2.0))
    tracemalloc.start()
    found = projections(points, around)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (found.count == len(points)).all()
    assert peak < 0.5e9
