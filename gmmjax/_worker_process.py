"""How a process begins that computes for another one.

This module imports neither NumPy nor JAX, so that what it sets is set before they are loaded.
"""

import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import wait

from gmmjax._cores import limit_cores

# How many threads XLA, OpenMP and OpenBLAS start.
THREADS = ("NPROC", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def start_worker(cores: int) -> None:
    """Prepares a process that another one has just started to compute for it.

    It uses so many cores, leaves Ctrl-C to the process that started it, and ends with that process, however it ends.

    Args:
        cores: that it may use.
    """
    use_cores(cores)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def use_cores(cores: int) -> None:
    """Lets this process use so many cores; XLA and the BLAS only where they have not started their threads yet.

    Args:
        cores: number of cores.
    """
    os.environ.update(dict.fromkeys(THREADS, str(cores)))
    limit_cores(cores)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
