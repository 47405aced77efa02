import pytest

from gmmjax.thesis.laboratory import recorded_run


@pytest.fixture(scope="session")
def recordings():
    """A cargo bag, and the gear box on top of it."""
    return [recorded_run(run, 0, frames=8) for run in ("bag", "stacked")]
