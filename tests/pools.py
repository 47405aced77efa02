"""A pool of workers without processes, for tests that are not about processes."""

from concurrent.futures import Future
from typing import Any

from gmmjax.batch.pools import AbstractPool


class PoolHere(AbstractPool):
    """Computes each call at once, in this process."""

    capacity = 1

    def submit(self, function: Any, *arguments: Any) -> "Future[Any]":
        done: Future[Any] = Future()
        done.set_result(function(*arguments))
        return done

    def stop(self, *, at_once: bool) -> None:
        pass
