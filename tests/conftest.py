"""Switches on what all tests share: shapes and types checked at run time, and no silent promotion."""

from jaxtyping import install_import_hook

with install_import_hook("gmmjax", "beartype.beartype"):
    import gmmjax
    import gmmjax.cli
    import gmmjax.evaluation
    import gmmjax.evaluation.surveys
    import gmmjax.evaluation.thesis
    import gmmjax.reporting
    import gmmjax.reporting.frame_files
    import gmmjax.reporting.lab_files
    import gmmjax.reporting.thesis_files
    import gmmjax.scenes
    import gmmjax.surveys
    import gmmjax.tuning  # noqa: F401

import os
import warnings
from pathlib import Path
from types import ModuleType

import hypothesis
import jax
import jaxtyping
import pytest

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# The first example of a shape compiles a program; the machines are shared.
hypothesis.settings.register_profile("gmmjax", deadline=None, max_examples=25, derandomize=True)
hypothesis.settings.load_profile("gmmjax")


@pytest.fixture
def float64():
    """The test runs in float64."""
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="session")
def scan_pairs() -> list[Path]:
    """Folders of real before/after scans with truth, where `GMMJAX_DATA` names a folder that has them."""
    folder = Path(os.environ.get("GMMJAX_DATA", "")) / "pairs"
    if "GMMJAX_DATA" not in os.environ or not folder.is_dir():
        pytest.skip("GMMJAX_DATA names no folder with scan pairs")
    return sorted(path for path in folder.iterdir() if (path / "before.ply").is_file())


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
