"""That the benchmark of many comparisons reckons as it says, on made-up times; and that its contenders compare."""

import numpy as np
import pytest

from tests.benchmarks import compared_pairs
from tests.benchmarks.compared_pairs import CACHED, DETECT, MANY, PEERS


def line(contender, *, size="4x8", first=5.0, again=(1.6, 3.2), turn=0):
    return {
        **{"contender": contender, "method": "greedy", "size": size, "turn": turn, "load": 1.0, "cpu": 64.0},
        **{"finished": [first, first + 1, first + 2, first + 3], "first_cpu": 2.0, "again": again},
    }


def test_seconds_a_comparison_are_those_of_the_second_call():
    row = compared_pairs.compared_table([line(MANY)]).splitlines()[-1]
    assert row.startswith("| compare_many | greedy | 4 x 8 | 1 | 5.0 s | 2.0 s | 50.0 ms | 100.0 ms | 1,125 |")


def test_processes_are_measured_between_their_results():
    assert compared_pairs.steady(line(DETECT, again=None)) == (1.0, 16.0)


def test_the_run_that_fills_the_folder_of_programs_does_not_count():
    rows = compared_pairs.compared_table([line(CACHED, first=9.0), line(CACHED, first=3.0, turn=1)])
    assert "| 1 | 3.0 s |" in rows


@pytest.mark.slow
@pytest.mark.parametrize("contender", [MANY, PEERS])
def test_contenders_give_a_result_for_each_pair(contender, tmp_path):
    pairs = [tuple(cloud[::20] for cloud in pair) for pair in compared_pairs.scenes(2)]
    found = list(compared_pairs.CALLS[contender]("greedy", pairs, 2, tmp_path / "log"))
    assert len(found) == 2


def test_scenes_have_one_gaussian_less_and_one_more():
    ((before, after),) = compared_pairs.scenes(1)
    assert before.shape == after.shape == (2000, 3)
    assert len(np.unique(before, axis=0)) == 2000
