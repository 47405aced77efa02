"""Local processes and foreign executors."""

import os
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import pytest

from gmmjax._cores import available_cores
from gmmjax.batch.pools import ExecutorPool, LocalPool, Workers, died
from gmmjax.errors import ComputationError, InputError
from tests.batch.runs import is_alive, kill, wait_for


@pytest.fixture
def pool():
    made = LocalPool(2, 1)
    yield made
    made.stop(at_once=True)


def test_calls_run_in_other_processes(pool):
    first, second = pool.submit(os.getpid), pool.submit(os.getpid)
    assert len({os.getpid(), first.result(), second.result()}) == 3


def test_a_killed_process_takes_only_its_own_call_along(pool):
    victim, other = pool.submit(time.sleep, 60), pool.submit(os.getpid)
    other.result()
    process = pool._lanes[0]._process.result()
    kill(process)
    with pytest.raises(BrokenExecutor) as caught:
        victim.result()
    assert died(caught.value)
    # The lane is replaced, the other process is still there.
    pool.submit(time.sleep, 60)
    assert pool.submit(os.getpid).result() == other.result()
    assert pool._lanes[0]._process.result() != process


def test_stopping_at_once_does_not_wait(pool):
    pool.submit(time.sleep, 60)
    process = pool._lanes[0]._process.result()
    pool.stop(at_once=True)
    wait_for(lambda: not is_alive(process), 30)


def test_workers_use_their_share_of_the_cores_and_end():
    made = LocalPool(1, 3)
    process = made.submit(os.getpid).result()
    assert made.submit(os.getenv, "NPROC").result() == "3"
    made.stop(at_once=False)
    assert not is_alive(process)


def available():
    return available_cores(), os.environ.get("NPROC")


def test_workers_of_others_get_one_core_and_threads_leave_this_process_alone():
    before = available()
    with ThreadPoolExecutor(1) as threads:
        assert ExecutorPool(threads, 1).submit(available).result() == before
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        assert ExecutorPool(processes, 1).submit(available).result() == (1, "1")
    assert available() == before


def test_there_are_no_more_workers_than_pairs():
    assert Workers().pool(1).capacity == 1
    assert Workers(3).pool(100).capacity == Workers(3).pool(None).capacity == 3
    with pytest.raises(InputError, match="workers=0 must be at least 1"):
        Workers(0)


def test_a_foreign_executor_computes_and_is_not_ended():
    with ThreadPoolExecutor(1) as executor:
        pool = ExecutorPool(executor, 4)
        assert pool.submit(divmod, 7, 2).result() == (3, 1)
        pool.stop(at_once=True)
        assert executor.submit(divmod, 7, 2).result() == (3, 1)


@pytest.mark.slow
def test_a_foreign_executor_that_is_broken_is_said():
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        pool = ExecutorPool(executor, 4)
        with pytest.raises(BrokenExecutor):
            pool.submit(os._exit, 1).result()
        with pytest.raises(ComputationError, match="the executor takes no more work"):
            pool.submit(divmod, 7, 2)
