"""Ways to write a result that the tests of faults need; workers import them from here."""

import os
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
    time.sleep(0.5)
