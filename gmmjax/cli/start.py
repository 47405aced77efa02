"""What the process does while the program is imported: it searches for no garbage, and Ctrl-C ends it at once."""

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
def no_search_of_imports(*, own_process: bool) -> Iterator[Callable[[], None]]:
    """Searches for no garbage while modules are imported, nor among them later, nor at the end of the process.

    Python finds none there, and takes a third of the start for it.

    Args:
        own_process: whether the process ends with the block; otherwise nothing is changed.

    Yields:
        A function to be called when all is imported, from where on the search is Python's usual one.
    """
    if not own_process:
        yield lambda: None
        return
    gc.disable()
    try:
        yield _search_again
    finally:
        gc.disable()
        gc.freeze()


def _search_again() -> None:
    gc.freeze()
    gc.enable()


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
    try:
        yield _python_way
    finally:
        _python_way()


def _python_way() -> None:
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(number: int, frame: Any) -> None:
    os.write(2, f"gmmjax: {INTERRUPTION}\n".encode())
    os._exit(INTERRUPTED)
