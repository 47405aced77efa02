"""Simulated scenes over several processes."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from gmmjax._cores import available_cores
from gmmjax._worker_process import start_worker

Task = TypeVar("Task")
Result = TypeVar("Result")


def over_workers(function: Callable[[Task], Result], tasks: Sequence[Task], workers: int) -> Iterator[Result]:
    """The results of all tasks, in their order: in this process, or in several others, which end with this one.

    Args:
        function: of one task; it and its results can be sent to another process.
        tasks: to do.
        workers: number of processes.
    """
    if workers == 1:
        yield from map(function, tasks)
        return
    cores = max(available_cores() // workers, 1)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=start_worker, initargs=(cores,)) as pool:
        yield from pool.map(function, tasks)
