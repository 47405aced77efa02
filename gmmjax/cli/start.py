"""The process while the program is imported: it searches for no garbage, and Ctrl-C ends it at once."""

import functools
import gc
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
def starting(*, own_process: bool) -> Iterator[Callable[[], None]]:
    """Searches for no garbage, and ends the process at Ctrl-C, until a function is called; then Python's usual way.

    Modules leave no garbage, and the search takes a third of the start. An import that is interrupted by an exception
    may turn it into another one, or print and swallow it; nothing is written yet, so that nothing is lost.

    Args:
        own_process: whether the process ends with the block; otherwise garbage is searched for as always.

    Yields:
        The function; to be called when all is imported, before the work begins.
    """
    # Whoever has another handler, or ignores the signal, as `nohup` does in the background, goes on doing so.
    if _has_handler(signal.default_int_handler):
        signal.signal(signal.SIGINT, _end)
    if own_process:
        gc.disable()
    try:
        yield functools.partial(_started, own_process=own_process)
    finally:
        _started(own_process=False)
        if own_process:
            # At the end of the process, too, there is nothing to be found.
            gc.disable()
            gc.freeze()


def _started(*, own_process: bool) -> None:
    if _has_handler(_end):
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if own_process:
        gc.freeze()
        gc.enable()


def _has_handler(handler: Callable[..., Any]) -> bool:
    return threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is handler


def _end(number: int, frame: Any) -> None:
    os.write(2, f"gmmjax: {INTERRUPTION}\n".encode())
    os._exit(INTERRUPTED)
