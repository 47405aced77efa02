import pytest

from gmmjax.thesis.laboratory import recorded_run


@pytest.fixture(scope="session")
def recordings():
    """Nothing, and a robot, a cargo bag and a gear box."""
    return [recorded_run(run, 0, frames=8) for run in ("run5", "run4")]
