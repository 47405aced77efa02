"""Several ways to compute one thing, timed in turns: what else the machine does falls on all of them alike."""

import dataclasses
import os
import resource
import statistics
import time
from collections.abc import Callable
from typing import Any

import jax
from threadpoolctl import threadpool_limits


@dataclasses.dataclass(frozen=True)
class Elsewhere:
    """What a contender returns that was timed in another process: its own seconds, and its answer."""

    wall: float
    cpu: float
    answer: Any


@dataclasses.dataclass
class Timing:
    """One contender's seconds, a value for each turn; `first` and `first_cpu` are those of its first call."""

    first: float = 0.0
    first_cpu: float = 0.0
    walls: list[float] = dataclasses.field(default_factory=list)
    cpus: list[float] = dataclasses.field(default_factory=list)
    answer: Any = None

    @property
    def wall(self) -> float:
        return statistics.median(self.walls)

    @property
    def cpu(self) -> float:
        return statistics.median(self.cpus)

    @property
    def compilation(self) -> float:
        """Wall seconds by which the first call, compilation included, is longer than the median of the others."""
        return max(0.0, self.first - self.wall)

    def summary(self) -> dict[str, Any]:
        return {
            "wall_s": self.wall,
            "cpu_s": self.cpu,
            "compilation_s": self.compilation,
            "walls_s": self.walls,
            "cpus_s": self.cpus,
        }


def cpu_seconds() -> float:
    """Of all threads of this process and of its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def timed(contender: Callable[[], Any]) -> Elsewhere:
    """Calls it once; the times are its own where it ran elsewhere."""
    wall, cpu = time.perf_counter(), cpu_seconds()
    answer = jax.block_until_ready(contender())
    wall, cpu = time.perf_counter() - wall, cpu_seconds() - cpu
    return answer if isinstance(answer, Elsewhere) else Elsewhere(wall, cpu, answer)


class Interleaved:
    """The contenders by name; a turn calls each of them once, the first turn is the warm-up.

    BLAS and OpenMP have one thread: the pools of NumPy and scikit-learn spin while they wait, which is counted as CPU
    time. XLA's threads are left as they are.
    """

    def __init__(self, contenders: dict[str, Callable[[], Any]]):
        self.contenders = contenders
        self.timings = {name: Timing() for name in contenders}
        self.warm = False
        jax.clear_caches()

    def turn(self) -> None:
        with threadpool_limits(1):
            for name, contender in self.contenders.items():
                done, timing = timed(contender), self.timings[name]
                timing.answer = done.answer
                if self.warm:
                    timing.walls.append(done.wall)
                    timing.cpus.append(done.cpu)
                else:
                    timing.first, timing.first_cpu = done.wall, done.cpu
        self.warm = True


def load() -> float:
    """The processes that want to run, mean of the last minute."""
    return os.getloadavg()[0]
