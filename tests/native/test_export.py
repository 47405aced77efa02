"""What is exported, or lowered for another device, is the plain code, whatever was compiled before."""

import os
import subprocess
import sys

import jax
import numpy as np
import pytest
from jax import export

from gmmjax import earth_movers_distance, fit_mixture, native
from gmmjax.comparison import remove_changed
from gmmjax.mixtures import FitSettings

pytestmark = [
    pytest.mark.usefixtures("float64"),
    pytest.mark.skipif(not native.available(), reason="the kernels were not built"),
]
TARGETS = ("custom_call @gmmjax_feature_sums", "custom_call @gmmjax_transport")
POINTS = np.concatenate([np.random.default_rng(0).normal(at, 0.3, (30, 3)) for at in (0, 3, 9)])
# Two clouds that share their restarts.
CLOUDS, KEYS = np.stack([POINTS, POINTS[::-1] * 1.1 + 0.2]), jax.random.split(jax.random.key(0), 3)


def compared(points, key):
    mixtures = [fit_mixture(own, key=key, max_components=4).mixture for own in (points, points[:60])]
    return earth_movers_distance(*mixtures).cost, remove_changed(*mixtures)


def gradient(points, key):
    settings = FitSettings(polish=True)
    return jax.grad(lambda own: fit_mixture(own, key=key, max_components=3, settings=settings).message_length)(points)


def batched(function):
    """A new function: JAX takes no program of an earlier one."""
    return jax.jit(jax.vmap(jax.vmap(lambda *own: function(*own), (None, 0)), (0, None)))


def assert_close(found, expected, tolerance):
    for own, wanted in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(np.asarray(own, float), np.asarray(wanted, float), rtol=tolerance, atol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("function", [compared, gradient])
def test_an_exported_function_is_plain_although_it_ran_with_kernels(function, monkeypatch):
    ours = batched(function)
    with_kernels = ours(CLOUDS, KEYS)
    exported = export.export(ours, platforms=("cpu", "cuda"))(CLOUDS, KEYS)
    assert not any(target in exported.mlir_module() for target in TARGETS)
    found = exported.call(CLOUDS, KEYS)
    assert_close(found, with_kernels, 1e-8)
    # And back again.
    assert_close(ours(CLOUDS, KEYS), with_kernels, 0)
    monkeypatch.setattr(native, "available", lambda: False)
    jax.clear_caches()
    assert_close(found, batched(function)(CLOUDS, KEYS), 1e-12)


def test_what_is_exported_or_lowered_for_another_device_is_plain():
    traced = batched(compared).trace(CLOUDS, KEYS)
    cpu, cuda = (traced.lower(lowering_platforms=(platform,)).as_text() for platform in ("cpu", "cuda"))
    assert all(target in cpu and target not in cuda for target in TARGETS)
    for platforms in (("cpu",), ("cpu", "cuda")):
        exported = export.export(batched(compared), platforms=platforms)(CLOUDS, KEYS).mlir_module()
        assert not any(target in exported for target in TARGETS)


SCRIPT = """
import sys, jax, numpy as np
exported = jax.export.deserialize(bytearray(open(sys.argv[1], "rb").read()))
given = np.load(sys.argv[2])
found = exported.call(given["clouds"], jax.random.wrap_key_data(given["keys"]))
assert not any(name.startswith("gmmjax") for name in sys.modules)
np.savez(sys.argv[3], *jax.tree.leaves(found))
"""


@pytest.mark.slow
def test_a_process_without_gmmjax_runs_what_was_exported(tmp_path):
    pytest.importorskip("flatbuffers", reason="jax.export writes with flatbuffers")
    program, given, found = (tmp_path / name for name in ("program", "given.npz", "found.npz"))

    def numbers(points, key):
        distance, removals = compared(points, key)
        return distance, removals.emd, removals.disappeared

    ours = batched(numbers)
    program.write_bytes(export.export(ours)(CLOUDS, KEYS).serialize())
    np.savez(given, clouds=CLOUDS, keys=jax.random.key_data(KEYS))
    environment = {**os.environ, "JAX_ENABLE_X64": "1"}
    subprocess.run([sys.executable, "-c", SCRIPT, program, given, found], env=environment, check=True)
    with np.load(found) as leaves:
        assert_close(list(leaves.values()), ours(CLOUDS, KEYS), 1e-8)
