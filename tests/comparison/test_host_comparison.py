import jax
import numpy as np
import pytest

from gmmjax import _programs
from gmmjax.comparison import Strengths, averaged
from gmmjax.comparison.cloud_comparison import planned
from gmmjax.comparison.host_comparison import HostPair, compare_prepared, compile_decision
from gmmjax.mixtures import stacked
from gmmjax.pair import Pair


@pytest.fixture(autouse=True)
def no_programs(monkeypatch):
    monkeypatch.setattr(_programs, "_programs", _programs.LatestUsed(_programs.MAX_PROGRAMS))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["greedy", "transport", "joint"])
def test_what_follows_the_fits_is_compiled_once(method):
    strengths, plan = planned(method, "both", None, "exact", 3, None, Strengths())
    points = np.random.default_rng(0).normal(size=(40, 2))
    pair = HostPair.of(Pair(points, points[:30]), Pair(None, None), None, plan)
    compile_decision(pair, strengths, plan)
    own = _programs_of("_changed", "_probability")
    assert len(own) >= 2 or method == "joint"
    compare_prepared(pair, jax.random.key(0), None, strengths, plan)
    assert _programs_of("_changed", "_probability") == own
    for program in own.values():
        assert program._cache_size() == 1


def _programs_of(*names):
    return {key: program for key, program in _programs._programs._values.items() if key[0].__name__ in names}


@pytest.mark.slow
def test_averages_are_one_program():
    strengths, plan = planned("greedy", "both", None, "exact", 3, None, Strengths())
    points = np.random.default_rng(0).normal(size=(40, 2))
    pair = HostPair.of(Pair(points, points[:30]), Pair(None, None), None, plan)
    keys = jax.random.split(jax.random.key(0), 2)
    restarts = stacked([compare_prepared(pair, key, None, strengths, plan) for key in keys])
    averaged(restarts)
    (program,) = _programs_of("mean_of_restarts").values()
    averaged(restarts)
    assert program._cache_size() == 1
