"""What all tests share: shapes and types checked at run time, no silent promotion, programs compiled once."""

import os
import tempfile

from tests import checked_calls, xla_flags  # noqa: F401

# The workers, and the processes that tests start, find in the folder of the first process what one of them compiled.
# A program is found by what it computes and how it is compiled; a test sees the one that it would compile itself.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    COMPILED = tempfile.TemporaryDirectory(prefix="gmmjax-compiled-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = COMPILED.name
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"

# Tests run side by side: threads of OpenBLAS that wait for each other took half of the time of small problems.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# XLA_FLAGS, empty too, has the programs compiled as they are for users, which `.ci/run` does for a part.
if "XLA_FLAGS" not in os.environ:
    os.environ["XLA_FLAGS"] = xla_flags.quickest_to_compile()

import warnings
from pathlib import Path
from types import ModuleType

import hypothesis
import jax
import jaxtyping
import pytest

# Whatever is imported of gmmjax from here on checks its types and shapes.
jaxtyping.install_import_hook("gmmjax", "tests.checked_calls.checked")

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# The first example of a shape compiles a program; the machines are shared.
hypothesis.settings.register_profile("gmmjax", deadline=None, max_examples=25, derandomize=True)
hypothesis.settings.load_profile("gmmjax")


# What gmmjax was developed on; the folder has harder pairs too, whose changes are not all found.
DEPTH_CAMERA_PAIRS = {
    *("mosd_learn14_15", "mosd_test44_47", "nochange_split_milk"),
    *("split_milk_carton_removed", "split_room_sixpack_removed"),
}


@pytest.fixture
def float64():
    """The test runs in float64."""
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="session")
def scan_pairs() -> list[Path]:
    """The five pairs of depth cameras' scans with truth, where `GMMJAX_DATA` names a folder that has them."""
    folder = Path(os.environ.get("GMMJAX_DATA", "")) / "pairs"
    if "GMMJAX_DATA" not in os.environ or not folder.is_dir():
        pytest.skip("GMMJAX_DATA names no folder with scan pairs")
    return sorted(path for path in folder.iterdir() if path.name in DEPTH_CAMERA_PAIRS)


@pytest.fixture(scope="session")
def open3d() -> ModuleType:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            import open3d
        except (ImportError, OSError) as error:
            pytest.skip(f"Open3D does not load: {error}")
    return open3d


@pytest.fixture
def as_users():
    """Without the check of types, which would refuse a wrong word before gmmjax sees it."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def no_workers(monkeypatch):
    """What is given to workers on this machine is computed in this process."""
    # Not above: the process that hands out the tests imports nothing of gmmjax.
    from tests.pools import PoolHere

    monkeypatch.setattr("gmmjax.batch.pools.LocalPool", lambda workers, cores: PoolHere())


@pytest.fixture(scope="module")
def no_compilation_cache():
    """JAX's own variable keeps the command line from changing JAX's settings for the other tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_COMPILATION_CACHE_DIR", "")
        yield
