"""What all benchmarks share: runs in new processes and in turns, a log of what was measured, tables in the pages.

A run of one contender is a line of a log (JSON), with the load of the machine, the versions and the day. What is in the
log is not measured again. A page has a place for each table, between `<!-- NAME: begin -->` and `<!-- NAME: end -->`.
"""

import argparse
import contextlib
import datetime
import functools
import importlib.metadata
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import jax
from threadpoolctl import threadpool_limits

PACKAGES = ("gmmjax", "jax", "numpy", "scikit-learn", "POT", "ott-jax", "gmmx", "py4dgeo", "laspy")
Line = dict[str, Any]


class Timed(NamedTuple):
    """Seconds of one call, what it returned, and the peak of memory of a process (GB)."""

    wall: float
    cpu: float
    answer: Any
    memory: float = 0.0


class Timing(NamedTuple):
    """The calls of one contender: the first one, which compiles, and the others."""

    first: Timed
    others: Sequence[Timed]

    @property
    def wall(self) -> float:
        return statistics.median(own.wall for own in self.others)

    @property
    def cpu(self) -> float:
        return statistics.median(own.cpu for own in self.others)

    @property
    def answer(self) -> Any:
        return self.others[-1].answer

    @property
    def compilation(self) -> float:
        """Wall seconds by which the first call is longer than the median of the others."""
        return max(0.0, self.first.wall - self.wall)


def interleaved(contenders: Mapping[str, Callable[[], Any]], repeats: int) -> dict[str, Timing]:
    """Calls all contenders in turns, so that what else the machine does falls on all alike.

    BLAS and OpenMP have one thread: the pools of NumPy and scikit-learn spin while they wait, which is counted as CPU
    time. XLA's threads are left as they are.
    """
    jax.clear_caches()
    calls: dict[str, list[Timed]] = {name: [] for name in contenders}
    with threadpool_limits(1):
        for _ in range(repeats + 1):
            for name, contender in contenders.items():
                calls[name].append(timed(contender))
    return {name: Timing(first, others) for name, (first, *others) in calls.items()}


def timed(contender: Callable[[], Any]) -> Timed:
    """Calls it once; the times are its own where it ran in another process and returns `Timed`."""
    wall, cpu = time.perf_counter(), cpu_seconds()
    answer = jax.block_until_ready(contender())
    wall, cpu = time.perf_counter() - wall, cpu_seconds() - cpu
    return answer if isinstance(answer, Timed) else Timed(wall, cpu, answer)


def cpu_seconds() -> float:
    """CPU time of all threads of this process and of its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@contextlib.contextmanager
def worker(cores: int | None = None, platform: str | None = None) -> Iterator[Callable[..., Timed]]:
    """A process of its own: call it with a function and arguments.

    Args:
        cores: that it sees, from before JAX is imported there; None: all.
        platform: the only one that JAX has there; None: as here.
    """
    chosen = sorted(os.sched_getaffinity(0))[:cores]
    start = {"initializer": os.sched_setaffinity, "initargs": (0, chosen)}
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), **start) as pool:
        yield lambda function, *arguments: pool.submit(_timed_there, platform, function, *arguments).result()


def _timed_there(platform: str | None, function: Callable[..., Any], *arguments: Any) -> Timed:
    if platform not in (None, jax.config.jax_platforms):
        jax.config.update("jax_platforms", platform)
    return timed(lambda: function(*arguments))


def run(words: Sequence[str], cores: Sequence[int] | None = None, **environment: str) -> Timed:
    """Runs a Python command in a process of its own.

    Args:
        words: what follows the interpreter.
        cores: that it may use; None: all.
        environment: variables beside those of this process.

    Returns:
        Wall and CPU seconds of it and of all its processes, its standard output, its peak of memory.

    Raises:
        SystemExit: it failed, with what it said.
    """
    own, wall = os.sched_getaffinity(0), time.perf_counter()
    # It inherits what this process may use.
    os.sched_setaffinity(0, own if cores is None else set(cores))
    process = subprocess.Popen(
        [sys.executable, *words],
        env={**os.environ, "OMP_NUM_THREADS": "1", **environment},
        stdout=subprocess.PIPE,
        text=True,
    )
    os.sched_setaffinity(0, own)
    assert process.stdout is not None
    with process.stdout as output:
        said = output.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(words)}: failed")
    return Timed(time.perf_counter() - wall, usage.ru_utime + usage.ru_stime, said, usage.ru_maxrss / 1e6)


def memory(name: str) -> int:
    """A line of this process's memory, bytes: "VmRSS" is in use, "VmHWM" was in use at most.

    Not `ru_maxrss`: a new process inherits the peak of the one that started it.
    """
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def load() -> float:
    """The processes that want to run, mean of the last minute."""
    return os.getloadavg()[0]


class Log:
    """The lines that were measured.

    Args:
        path: JSON lines; None: nothing is kept.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.lines: list[Line] = []
        if path is not None and path.exists():
            self.lines = [json.loads(line) for line in path.read_text().splitlines()]

    def measure(self, key: Mapping[str, Any], measured: Callable[[], Mapping[str, Any]]) -> Line:
        """The line of a key; it is measured where there is none yet."""
        known = json.loads(json.dumps(dict(key)))
        for line in self.lines:
            if {name: line.get(name) for name in known} == known:
                return line
        before = load()
        found = {**known, **measured(), "load": max(before, load()), "conditions": conditions()}
        line = json.loads(json.dumps(found))
        self.lines.append(line)
        if self.path is not None:
            with self.path.open("a") as file:
                file.write(json.dumps(line) + "\n")
        return line


def options(description: str | None) -> argparse.ArgumentParser:
    """A parser with what all benchmarks take."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--log", type=Path, help="JSON lines; what is in it is not measured again")
    parser.add_argument("--page", type=Path, help="Markdown file with a place for the table; else it is printed")
    parser.add_argument("--quick", action="store_true", help="tiny sizes, to try it")
    return parser


def tabulate(
    description: str | None, name: str, columns: Sequence[str], cases: Mapping[str, Callable[[bool], dict[str, Any]]]
) -> None:
    """The table of a script: the rows of each case, whether on a page or printed, with the load that they were made at.

    Args:
        description: of the script.
        name: of the table's place in a page.
        columns: their headings, of which the last one is the load.
        cases: by name, what measures rows; it is told whether tiny sizes will do.
    """
    arguments = options(description).parse_args()
    log, rows = Log(arguments.log), []
    for label, case in cases.items():
        line = log.measure({"case": label, "quick": arguments.quick}, functools.partial(case, arguments.quick))
        rows += [[*row, f"{line['load']:.1f}"] for row in line["rows"]]
    put(arguments.page, name, table(columns, rows))


def table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def seconds(value: float) -> str:
    """Three digits and a unit."""
    scale, unit = next(pair for pair in ((1, "s"), (1e3, "ms"), (1e6, "µs")) if value * pair[0] >= 1 or pair[0] == 1e6)
    return f"{value * scale:.3g} {unit}"


def put(page: Path | None, name: str, text: str) -> None:
    """Replaces what stands in a page at the place of this name; without a page it is printed.

    Day, machine and versions stand above it.

    Raises:
        SystemExit: the page has no such place.
    """
    text = f"{conditions()}\n\n{text}"
    if page is None:
        print(text)
        return
    marks = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    content = page.read_text()
    if not all(content.count(mark) == 1 for mark in marks):
        raise SystemExit(f"{page}: has no place for this; write {marks[0]} and {marks[1]} where it shall stand")
    before, rest = content.split(marks[0])
    page.write_text(f"{before}{marks[0]}\n\n{text}\n\n{marks[1]}{rest.split(marks[1])[1]}")


def conditions() -> str:
    """The day, the machine, and the versions."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    processor = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), "CPU unknown")
    versions = []
    for name in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions.append(f"{name} {importlib.metadata.version(name)}")
    cores = len(os.sched_getaffinity(0))
    return f"{datetime.date.today()}, {processor}, {cores} cores; {', '.join(versions)}."
