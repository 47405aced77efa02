"""Processes of their own: with a given number of cores, or with a peak of memory that is theirs alone."""

import contextlib
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import jax

from tests.benchmarks.interleaved import Elsewhere, timed


@contextlib.contextmanager
def worker(cores=None, platform=None):
    """A process: call it with a function and arguments.

    Args:
        cores: that it sees, from before JAX is imported there; None: all.
        platform: the only one that JAX has there; None: as here.
    """
    chosen = sorted(os.sched_getaffinity(0))[:cores]
    with ProcessPoolExecutor(
        1, mp_context=get_context("spawn"), initializer=os.sched_setaffinity, initargs=(0, chosen)
    ) as pool:
        yield lambda function, *arguments: pool.submit(_timed_call, platform, function, *arguments).result()


def _timed_call(platform, function, *arguments) -> Elsewhere:
    if platform not in (None, jax.config.jax_platforms):
        jax.config.update("jax_platforms", platform)
    return timed(lambda: function(*arguments))


def memory(name):
    """A line of the process's own memory, bytes: "VmRSS" is in use, "VmHWM" was in use at the most.

    Not `ru_maxrss`: a new process inherits the peak of the one that started it.
    """
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def forget_peak_memory():
    """Lets the process's own "VmHWM" begin anew, at what is in use now."""
    Path("/proc/self/clear_refs").write_text("5")
