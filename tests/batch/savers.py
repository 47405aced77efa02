"""Ways to write a result that the tests of faults need; workers import them from here."""

import os
import resource
import signal
import time

from gmmjax.batch import save_changes


def save_unless_bad(folder, found):
    """Ends its process where it gets to a pair called bad, as a system without memory does."""
    if found.name.startswith("bad"):
        os.kill(os.getpid(), signal.SIGKILL)
    save_changes(folder, found)


def save_slowly(folder, found):
    """Leaves the time to kill the worker in the middle of a pair."""
    save_changes(folder, found)
    time.sleep(0.2)


def save_on_full_disk(folder, found):
    """Fails in the middle of a file: a limit on their size stands for a disk without space."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
        save_changes(folder, found)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
