"""Two clouds that are read at the same time."""

import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import Any, TypeVar

from gmmjax._cores import available_cores
from gmmjax.pair import Pair, each

Read = TypeVar("Read")
Made = TypeVar("Made")


class _StoppedError(Exception):
    """The other cloud could not be read."""


def read_both(function: Callable[..., Made], chunks: Pair[Iterable[Read]], *pairs: Pair[Any]) -> Pair[Made]:
    """The function's value for either cloud, both at the same time where there are two cores.

    Where one fails, or at Ctrl-C, the other one ends with its next chunk.

    Args:
        function: of the chunks of a cloud, and of that cloud's own of all other pairs; it releases Python's lock.
        chunks: of both clouds.
        pairs: further arguments.
    """
    if available_cores() < 2:
        return each(function, chunks, *pairs)
    stop = threading.Event()
    with ThreadPoolExecutor(2) as threads:
        futures = each(lambda own, *others: threads.submit(function, _until(stop, own), *others), chunks, *pairs)
        try:
            done = wait(list(futures), return_when=FIRST_EXCEPTION).done
            for future in futures:
                if future in done:
                    future.result()
        finally:
            stop.set()
    return futures.map(lambda future: future.result())


def _until(stop: threading.Event, chunks: Iterable[Read]) -> Iterator[Read]:
    for chunk in chunks:
        if stop.is_set():
            raise _StoppedError
        yield chunk
