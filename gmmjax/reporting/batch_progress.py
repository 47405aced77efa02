"""Progress of a batch run on standard error: a bar on a terminal, a line now and then in a log."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn

# Seconds between two lines in a log.
EVERY = 30.0


class BatchProgress:
    """Counts of pairs: those of the run, with a result, without one, and with one of an earlier run."""

    def __init__(self, total: int, show: "Callable[[BatchProgress], object] | None" = None) -> None:
        self.total, self.done, self.failed, self.reused = total, 0, 0, 0
        self._show, self._began = show, time.monotonic()

    def count(self, *, done: bool, reused: bool) -> None:
        """Count a pair: whether it is `done`, has a result, and whether that is `reused` from an earlier run."""
        self.done += done
        self.failed += not done
        self.reused += reused
        if reused:
            # What was there costs nothing: the rate is that of what is computed.
            self._began = time.monotonic()
        elif self._show is not None:
            self._show(self)

    @property
    def finished(self) -> int:
        """The number of pairs that are done or failed."""
        return self.done + self.failed

    @property
    def counts(self) -> str:
        """The pairs that are done, in words: "37 of 200 done, 12 from before, 1 failed"."""
        parts = [f"{self.done} of {self.total} done"]
        parts += [f"{self.reused} from before"] if self.reused else []
        parts += [f"{self.failed} failed"] if self.failed else []
        return ", ".join(parts)

    @property
    def text(self) -> str:
        """The progress, in words: "37 of 200 done, 1 failed, 1.3 a second, 2 min left"."""
        parts = [self.counts]
        computed, seconds = self.finished - self.reused, time.monotonic() - self._began
        if computed and seconds > 0:
            rate = computed / seconds
            parts += [_rate(rate), f"{_duration((self.total - self.finished) / rate)} left"]
        return ", ".join(parts)


class _Log:
    """Prints a line where the latest is old enough, and at the end."""

    def __init__(self) -> None:
        self._latest = -math.inf

    def __call__(self, progress: BatchProgress) -> None:
        if time.monotonic() - self._latest > EVERY or progress.finished == progress.total:
            self._latest = time.monotonic()
            print(f"gmmjax: {progress.text}", file=sys.stderr, flush=True)


@contextmanager
def batch_progress(total: int, *, quiet: bool = False) -> Iterator[BatchProgress]:
    """Show how far a run of `total` pairs has got while the block runs; yields what counts them."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield BatchProgress(total, None if quiet else _Log())
        return
    columns = SpinnerColumn(), BarColumn(20), TextColumn("{task.description}")
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(BatchProgress(total).text, total=total)
        yield BatchProgress(total, lambda own: bar.update(task, description=own.text, completed=own.finished))


def _rate(rate: float) -> str:
    return f"{rate:.1f} a second" if rate >= 1 else f"{60 * rate:.1f} a minute"


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
