import jax
import pytest

from gmmjax.scenes import random_scene


@pytest.fixture(scope="package")
def scene_points():
    """A thousand points of five Gaussians that lie apart, in metres."""
    return random_scene(jax.random.key(5), appeared=0, points=200).before
