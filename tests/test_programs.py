"""How many compiled programs a process keeps."""

import gc

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gmmjax import _programs
from gmmjax._programs import LatestUsed, lru_jit


def live_programs():
    gc.collect()
    return len(jax.devices()[0].client.live_executables())


@pytest.fixture
def three(monkeypatch):
    """At most three programs are kept."""
    monkeypatch.setattr(_programs, "_programs", LatestUsed(3))


traced: list[int] = []


@lru_jit
def scaled(values, *, factor, reverse=False):
    traced.append(len(values))
    return factor * (values[::-1] if reverse else values)


def test_values_are_those_of_the_function():
    np.testing.assert_array_equal(scaled(np.arange(3, dtype=np.float32), factor=2, reverse=True), [4, 2, 0])
    with jax.enable_x64(True):
        assert scaled(np.arange(3.0), factor=0.1).dtype == jnp.float64
    assert scaled(np.arange(3.0), factor=0.1).dtype == jnp.float32


def test_a_program_is_compiled_once_while_it_is_kept(three):
    traced.clear()
    for size in (1, 2, 3, 1, 2, 3):
        scaled(np.ones(size, np.float32), factor=2)
    assert len(traced) == 3
    scaled(np.ones(3, np.float32), factor=3)
    scaled(np.ones(1, np.float32), factor=2)
    assert len(traced) == 5


@pytest.mark.slow
def test_programs_do_not_pile_up(three):
    scaled(np.ones(1, np.float32), factor=2)
    before = live_programs()
    for size in range(2, 12):
        scaled(np.ones(size, np.float32), factor=2)
    assert live_programs() - before <= 2


def test_what_was_used_last_is_kept():
    kept = LatestUsed(2)
    for key in ("a", "b", "a", "c"):
        kept.get(key, lambda key=key: key * 2)
    assert kept.get("a", lambda: "anew") == "aa"
    assert kept.get("b", lambda: "anew") == "anew"
    assert len(kept) == 2
