"""Ctrl-C while the program is still being imported."""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# What a shell reports for a program that SIGINT ended.
INTERRUPTED = 130
INTERRUPTION = "interrupted"


@contextmanager
def interruptions() -> Iterator[Callable[[], None]]:
    """Ends the process at once, with a line and the status, at Ctrl-C; after the function is called Python's way again.

    An import that is interrupted by an exception may turn it into another one, or print and swallow it. Nothing is
    written yet while the program is imported, so that nothing is lost.

    Yields:
        The function; to be called when all is imported, before the work begins.
    """
    python_way = signal.default_int_handler
    # Whoever has another handler, or ignores the signal, as `nohup` does in the background, goes on doing so.
    ours = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is python_way
    if ours:
        signal.signal(signal.SIGINT, _end)

    def loaded() -> None:
        if ours and signal.getsignal(signal.SIGINT) is _end:
            signal.signal(signal.SIGINT, python_way)

    try:
        yield loaded
    finally:
        loaded()


def _end(number: int, frame: Any) -> None:
    os.write(2, f"gmmjax: {INTERRUPTION}\n".encode())
    os._exit(INTERRUPTED)
