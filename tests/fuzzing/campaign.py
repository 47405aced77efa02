"""Runs mutants through a worker, which is started again where it dies or hangs."""

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

ROOT = Path(__file__).parents[2]
# Seconds by the clock after which a mutant hangs; the limit of the others is of processor time, as the machine may be
# busy.
HANGS = 60.0


@dataclasses.dataclass(frozen=True)
class Limits:
    """What reading a file may take at most: seconds of processor time, and bytes."""

    seconds: float = 5.0
    memory: int = 2 << 30


@dataclasses.dataclass
class Report:
    """What became of the mutants of a target.

    Attributes:
        target: its name.
        outcomes: how many were read, refused by an `InputError`, and ended in a defect.
        defects: index and description of the latter.
        slowest: processor seconds of the slowest.
    """

    target: str
    outcomes: Counter[str] = dataclasses.field(default_factory=Counter)
    defects: list[tuple[int, str]] = dataclasses.field(default_factory=list)
    slowest: float = 0.0

    def add(self, index: int, outcome: str, detail: str = "", seconds: float = 0.0) -> None:
        """Counts a mutant."""
        self.outcomes[outcome] += 1
        self.slowest = max(self.slowest, seconds)
        if outcome == "defect":
            self.defects.append((index, detail))

    def __str__(self) -> str:
        """One line."""
        counts = ", ".join(f"{self.outcomes[name]} {name}" for name in ("read", "refused", "defect"))
        return f"{self.target}: {counts}; slowest {self.slowest:.2f} s"


class Fuzzer:
    """Reads mutants in a process of its own. Use as a context."""

    def __init__(self, hangs: float = HANGS) -> None:
        self._hangs = hangs
        self._home = tempfile.TemporaryDirectory(prefix="fuzzing-")
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Fuzzer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()
        self._home.cleanup()

    def run(self, target: str, mutations: int, seed: int = 0, start: int = 0, limits: Limits = Limits()) -> Report:
        """Reads the mutants `start` to `start + mutations` of a seed; the same seed gives the same mutants."""
        report, index, stop = Report(target), start, start + mutations
        while index < stop:
            begun = None
            request = {"target": target, "seed": seed, "start": index, "stop": stop} | dataclasses.asdict(limits)
            for answer in self._answers(request):
                if answer["index"] is None:
                    return report
                if "outcome" in answer:
                    report.add(**answer)
                    index = answer["index"] + 1
                else:
                    begun = answer["index"]
            # The worker has ended within this mutant.
            status = self._end()
            if begun is None:
                raise RuntimeError(f"the worker ended (status {status}) before the mutants of {target}; see above why")
            report.add(begun, "defect", f"the process hung or died (status {status})")
            index = begun + 1
        return report

    def _answers(self, request: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """The worker's answers, until it ends; it is killed when it is silent for too long."""
        process = self._running()
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(json.dumps(request | {"folder": os.path.join(self._home.name, "files")}) + "\n")
        process.stdin.flush()
        while True:
            timer = threading.Timer(self._hangs, process.kill)
            timer.start()
            line = process.stdout.readline()
            timer.cancel()
            if not line:
                return
            yield json.loads(line)

    def _running(self) -> subprocess.Popen[str]:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.fuzzing.worker"],
                cwd=ROOT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        return self._process

    def _end(self) -> int | None:
        process, self._process = self._process, None
        if process is None:
            return None
        assert process.stdin is not None and process.stdout is not None
        process.kill()
        process.stdout.close()
        process.stdin.close()
        return process.wait()
