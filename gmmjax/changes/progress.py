"""How far a detection has got, and what each of its stages took."""

import time
from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of the work that is done, from any thread."""


class Clock:
    """Seconds of each stage, from one lap to the next."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Ends a stage."""
        now = time.perf_counter()
        self.seconds[stage], self._last = round(now - self._last, 3), now
