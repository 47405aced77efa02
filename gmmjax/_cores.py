"""The processor cores that this process may use."""

import os

_limit: int | None = None


def available_cores() -> int:
    """The processor cores that this process may use: those that the system lets it, or less by `limit_cores`."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return cores if _limit is None else min(cores, _limit)


def limit_cores(count: int | None) -> None:
    """Lets this process use fewer cores, for all that is computed from then on; None: as many as the system lets it."""
    global _limit
    _limit = count
