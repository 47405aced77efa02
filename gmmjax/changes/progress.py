"""How far a detection has got, and what each of its stages took."""

import time
from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of the work that is done, from any thread."""


def silent(stage: str, share: float) -> None:
    """A progress that nobody looks at."""


class Clock:
    """Reports the stages of a detection, and measures them.

    Attributes:
        seconds: of each stage that has ended, by its name.
    """

    def __init__(self, report: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._report = report
        self._stage: str | None = None
        self._began = 0.0

    def start(self, stage: str, message: str, share: float) -> None:
        """Ends the stage that is going on, and begins the next.

        Args:
            stage: its name in `seconds`.
            message: what the user reads.
            share: of the work that is done.
        """
        self._end()
        self._stage, self._began = stage, time.perf_counter()
        self._report(message, share)

    def finish(self) -> None:
        """Ends the last stage."""
        self._end()
        self._stage = None
        self._report("Done", 1.0)

    def _end(self) -> None:
        if self._stage is not None:
            self.seconds[self._stage] = round(time.perf_counter() - self._began, 3)
