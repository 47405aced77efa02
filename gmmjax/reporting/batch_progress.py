"""How far a batch run has got, on standard error: a bar on a terminal, a line now and then in a log."""

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn


class BatchProgress:
    """Count pairs, and shows how many are done.

    Attributes:
        total: pairs of the run.
        done: that have a result.
        failed: that have none.
        reused: of those done, from an earlier run.
    """

    def __init__(self, total: int) -> None:
        self.total, self.done, self.failed, self.reused = total, 0, 0, 0
        self._began = time.monotonic()

    def count(self, *, done: bool, reused: bool) -> None:
        """Count a pair.

        Args:
            done: whether it has a result.
            reused: whether that is from an earlier run.
        """
        self.done += done
        self.failed += not done
        self.reused += reused
        if reused:
            # What was there costs nothing: the rate is that of what is computed.
            self._began = time.monotonic()
        else:
            self.show()

    def show(self) -> None:
        """Nowhere."""

    @property
    def counts(self) -> str:
        """How many pairs are done, in words: "37 of 200 done, 12 from before, 1 failed"."""
        parts = [f"{self.done} of {self.total} done"]
        parts += [f"{self.reused} from before"] if self.reused else []
        parts += [f"{self.failed} failed"] if self.failed else []
        return ", ".join(parts)

    @property
    def text(self) -> str:
        """How far it has got, in words: "37 of 200 done, 1 failed, 1.3 a second, 2 min left"."""
        parts = [self.counts]
        computed, seconds = self.done + self.failed - self.reused, time.monotonic() - self._began
        if computed and seconds > 0:
            rate = computed / seconds
            parts += [_rate(rate), f"{_duration((self.total - self.done - self.failed) / rate)} left"]
        return ", ".join(parts)


class _Bar(BatchProgress):
    def __init__(self, total: int, progress: Progress) -> None:
        super().__init__(total)
        self._progress = progress
        self._task = progress.add_task(self.text, total=total)

    def show(self) -> None:
        self._progress.update(self._task, description=self.text, completed=self.done + self.failed)


class _Lines(BatchProgress):
    def __init__(self, total: int, every: float) -> None:
        super().__init__(total)
        self._every, self._latest = every, -math.inf

    def show(self) -> None:
        if time.monotonic() - self._latest > self._every or self.done + self.failed == self.total:
            self._latest = time.monotonic()
            print(f"gmmjax: {self.text}", file=sys.stderr, flush=True)


@contextmanager
def batch_progress(total: int, *, quiet: bool = False, every: float = 30.0) -> Iterator[BatchProgress]:
    """Show how far a run has got while the block runs.

    Args:
        total: pairs of the run.
        quiet: show nothing.
        every: seconds between two lines in a log.

    Yields:
        What counts the pairs.
    """
    console = Console(stderr=True)
    if quiet:
        yield BatchProgress(total)
    elif not console.is_terminal:
        yield _Lines(total, every)
    else:
        columns = SpinnerColumn(), BarColumn(20), TextColumn("{task.description}")
        with Progress(*columns, console=console, transient=True) as progress:
            yield _Bar(total, progress)


def _rate(rate: float) -> str:
    return f"{rate:.1f} a second" if rate >= 1 else f"{60 * rate:.1f} a minute"


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
