"""The progress of a detection, and the time that each of its stages took."""

import logging
import time
from collections.abc import Callable

logger = logging.getLogger(__name__)

Progress = Callable[[str, float], None]
"""Called with the name of a stage and the share of the work that is done, from any thread."""


def silent(stage: str, share: float) -> None:
    """A progress that nobody looks at."""


class Clock:
    """Reports the stages of a detection, and measures them.

    Attributes:
        seconds: of each stage that has ended, by its name; of one that came several times, all of them.
        most: the share of the work that is reported as done at the most: below 1 while the fits are not all computed.
    """

    def __init__(self, report: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self.most = 1.0
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
        self.stop()
        self._stage, self._began = stage, time.perf_counter()
        logger.debug("%s", message)
        self.tell(message, share)

    def tell(self, message: str, share: float) -> None:
        """Reports how far the stage has got; from any thread.

        Args:
            message: what the user reads.
            share: of the work that is done.
        """
        self._report(message, min(share, self.most))

    def stop(self) -> None:
        """Ends the stage that is going on."""
        if self._stage is not None:
            before, now = self.seconds.get(self._stage, 0.0), time.perf_counter()
            self.seconds[self._stage] = round(before + now - self._began, 3)
            logger.info("%s: %.2f s", self._stage, now - self._began)
        self._stage = None

    def finish(self) -> None:
        """Ends the last stage."""
        self.stop()
        self._report("Done", 1.0)
