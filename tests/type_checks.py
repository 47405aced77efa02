"""The check of types that the tests have gmmjax imported with."""

import functools
from collections.abc import Callable
from typing import Any

from beartype import beartype


def when_called(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check a function's types from its first call on.

    beartype takes 2 ms of CPU to make the check of a function: of all that gmmjax has, half of the time that a worker
    takes to start, and most of them are never called there.
    """
    checked = functools.cache(functools.partial(beartype, function))
    return functools.wraps(function)(lambda *args, **kwargs: checked()(*args, **kwargs))
