"""Wall and CPU seconds of `gmmjax batch` on one core and on all, and of a loop over `gmmjax detect`, in turns.

Each turn gives all contenders the same pairs, other ones than the turn before, and fresh folders; the contender that
begins is another one each time. Before the first turn all pairs are computed once, so that the cache has all programs.
"""

import dataclasses
import json
import os
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.benchmarks.batch_pairs import MANIFEST, read_manifest, write_manifest
from tests.benchmarks.interleaved import load

ONE_CORE, ALL_CORES, LOOP = "batch, one core", "batch, all cores", "loop over detect"
CONTENDERS = (ONE_CORE, ALL_CORES, LOOP)
# The turns that are no turn: what fills the cache, and the one run of all pairs.
WARM_UP, WHOLE = "warm-up", "whole"
# What the issue asks of 200 pairs with 16 restarts on two cores: against one core, against the loop; the share of time.
ASKED_OF_CORES, ASKED_OF_LOOP, ASKED_SHARE, ASKED_PAIRS = 1.8, 6.0, 0.05, 200


@dataclasses.dataclass(frozen=True)
class Measured:
    """One contender in one turn.

    Attributes:
        kind: of the pairs.
        turn: its number from 0 on, or `WARM_UP` or `WHOLE`.
        contender: one of `CONTENDERS`.
        workers: number of processes that compute side by side.
        pairs: number of pairs.
        wall: seconds from the start of the command to its end; of the loop, of all its commands.
        cpu: seconds of all its processes.
        finished: seconds from the start at which each pair was done, in their order.
        detection: of each pair, in the same order, seconds of detection; batch runs alone know them.
        reading: likewise, of reading its files.
        writing: likewise, of writing its results.
        load: processes that wanted to run, before and after.
    """

    kind: str
    turn: int | str
    contender: str
    workers: int
    pairs: int
    wall: float
    cpu: float
    finished: list[float]
    detection: list[float]
    reading: list[float]
    writing: list[float]
    load: list[float]

    @property
    def steady(self) -> float:
        """Wall seconds a pair without the start: from when every worker has done one pair to when the last is done."""
        first = self.finished[self.workers - 1]
        return (self.finished[-1] - first) / (self.pairs - self.workers)

    @property
    def start(self) -> float:
        """Wall seconds that the run takes over the steady rate: its start, first pairs, summary and end."""
        return self.wall - self.steady * self.pairs

    @property
    def not_detection(self) -> float:
        """Share of the workers' wall time, from start to end, in which none of them detects."""
        return 1 - sum(self.detection) / (self.wall * self.workers)

    @property
    def not_detection_when_steady(self) -> float:
        """The same from when every worker has done one pair to when the last is done."""
        return 1 - statistics.mean(self.detection[self.workers :]) / (self.steady * self.workers)


def measure(
    manifest: Path, log: Path, scratch: Path, *, chunk: int, turns: int, restarts: int, contenders: Sequence[str]
) -> list[Measured]:
    """Measures what is not in the log yet, and returns all that the log has of this manifest.

    Args:
        manifest: what `write_pairs` wrote; its folder's name is the kind.
        log: JSON lines.
        scratch: folder for the results, which are removed.
        chunk: pairs in a turn.
        turns: number of turns; there must be pairs for all of them.
        restarts: of each pair.
        contenders: that take part.
    """
    kind, pairs = manifest.parent.name, read_manifest(manifest)
    if len(pairs) < chunk * turns:
        raise SystemExit(f"{manifest}: has {len(pairs)} pairs; {turns} turns of {chunk} need {chunk * turns}")
    done = {(line.turn, line.contender) for line in read(log, kind)}
    plan: list[tuple[int | str, str, list[list[str]]]] = [(WARM_UP, ALL_CORES, pairs)]
    for turn in range(turns):
        first = turn % len(contenders)
        own = pairs[turn * chunk : (turn + 1) * chunk]
        plan += [(turn, contender, own) for contender in (*contenders[first:], *contenders[:first])]
    plan.append((WHOLE, ALL_CORES, pairs))
    for turn, contender, own in plan:
        if (turn, contender) in done:
            continue
        folder = scratch / f"{kind}-{turn}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        line = timed(kind, turn, contender, own, folder, restarts)
        shutil.rmtree(folder)
        with log.open("a") as file:
            file.write(json.dumps(dataclasses.asdict(line)) + "\n")
    return read(log, kind)


def read(log: Path, kind: str | None = None) -> list[Measured]:
    """What was measured of a kind of pairs; None: of all."""
    lines = log.read_text().splitlines() if log.exists() else []
    return [own for own in (Measured(**json.loads(line)) for line in lines) if kind in (None, own.kind)]


def timed(kind: str, turn: int | str, contender: str, pairs: list[list[str]], folder: Path, restarts: int) -> Measured:
    """Runs a contender on these pairs in an empty folder."""
    cores = sorted(os.sched_getaffinity(0))
    before, began, wall = load(), time.time(), time.perf_counter()
    if contender == LOOP:
        workers = 1
        cpu, finished = _looped(pairs, folder, restarts, began)
        records = []
    else:
        workers = 1 if contender == ONE_CORE else len(cores)
        write_manifest(folder / MANIFEST, pairs)
        out = folder / "run"
        words = ["batch", str(folder / MANIFEST), "--out", str(out), "--restarts", str(restarts)]
        cpu = command([*words, "--workers", str(workers), "--quiet"], cores[:workers])
        records = [json.loads((out / "pairs" / name / "pair.json").read_text()) for name, *_ in pairs]
        records.sort(key=lambda record: record["finished"])
        finished = [record["finished"] - began for record in records]
    wall = time.perf_counter() - wall
    parts = {part: [record["seconds"][part] for record in records] for part in ("detection", "reading", "writing")}
    return Measured(kind, turn, contender, workers, len(pairs), wall, cpu, finished, load=[before, load()], **parts)


def _looped(pairs: list[list[str]], folder: Path, restarts: int, began: float) -> tuple[float, list[float]]:
    """What a shell does: one command after the other. CPU seconds, and when each was done."""
    cpu, finished = 0.0, []
    for name, before, after in pairs:
        out = folder / name
        cpu += command(["detect", before, after, "--out", str(out), "--restarts", str(restarts), "--quiet"])
        finished.append(time.time() - began)
    return cpu, finished


def command(words: list[str], cores: Sequence[int] | None = None) -> float:
    """Runs a command of gmmjax on these cores, None: on all; returns the CPU seconds of it and of all its processes.

    Raises:
        SystemExit: it failed, with what it said.
    """
    chosen = None if cores is None else (lambda: os.sched_setaffinity(0, set(cores)))
    process = subprocess.Popen([sys.executable, "-m", "gmmjax", *words], preexec_fn=chosen, stderr=subprocess.PIPE)
    assert process.stderr is not None
    said = process.stderr.read().decode()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"gmmjax {' '.join(words)} failed: {said.strip()}")
    return usage.ru_utime + usage.ru_stime


COLUMNS = (
    *("pairs", "contender", "runs x pairs", "wall a pair, with start", "CPU a pair", "start", "wall a pair, steady"),
    *("pairs an hour, steady", "reading", "detection", "writing", "not detection", "load"),
)


def table(lines: list[Measured]) -> str:
    """A row for each contender, medians over the turns; and one for each run of all pairs."""
    rows = ["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
    by_contender: dict[tuple[str, str, bool], list[Measured]] = {}
    for line in lines:
        if line.turn != WARM_UP:
            by_contender.setdefault((line.kind, line.contender, line.turn == WHOLE), []).append(line)
    rows += [row(group) for _, group in sorted(by_contender.items(), key=lambda item: item[0])]
    return "\n".join(rows)


def row(group: list[Measured]) -> str:
    """Medians over the turns of one contender."""

    def median(of: Any) -> float:
        return statistics.median(of(line) for line in group)

    first = group[0]
    steady = median(lambda line: line.steady)
    cells = [
        *(first.kind, first.contender, f"{len(group)} x {first.pairs}"),
        *(
            f"{median(lambda line: line.wall / line.pairs):.2f} s",
            f"{median(lambda line: line.cpu / line.pairs):.2f} s",
        ),
    ]
    if first.contender == LOOP:
        # Every command has its own start.
        wall = median(lambda line: line.wall / line.pairs)
        cells += ["", "", f"{3600 / wall:,.0f}", "", "", "", ""]
    else:
        parts = (lambda line: line.reading, lambda line: line.detection, lambda line: line.writing)
        cells += [f"{median(lambda line: line.start):.1f} s", f"{steady:.2f} s", f"{3600 / steady:,.0f}"]
        cells += [f"{median(lambda line, part=part: statistics.mean(part(line))):.2f} s" for part in parts]
        cells += [f"{median(lambda line: line.not_detection):.1%}"]
    cells.append(f"{min(min(line.load) for line in group):.1f} to {max(max(line.load) for line in group):.1f}")
    return "| " + " | ".join(cells) + " |"


def verdicts(lines: list[Measured]) -> str:
    """What was asked of 200 pairs, by kind: with the start as it is where all pairs were one run, else reckoned."""
    rows = ["| pairs | what | asked | measured | reached |", "|---|---|---|---|---|"]
    for kind in dict.fromkeys(line.kind for line in lines):
        own = [line for line in lines if line.kind == kind and line.turn != WARM_UP]
        seconds = {contender: of_many(own, contender) for contender in CONTENDERS}
        both = seconds[ALL_CORES]
        if both is None:
            continue
        for contender, asked in ((ONE_CORE, ASKED_OF_CORES), (LOOP, ASKED_OF_LOOP)):
            if (other := seconds[contender]) is not None:
                what = f"{ASKED_PAIRS} pairs, all cores against {contender}"
                rows.append(verdict(kind, what, f"≥ {asked} x", f"{other / both:.2f} x", other / both >= asked))
        for line in own:
            if line.turn == WHOLE:
                what = f"{line.pairs} pairs in one run: share of time that is not detection"
                for part, share in (("", line.not_detection), (", without start", line.not_detection_when_steady)):
                    rows.append(
                        verdict(kind, what + part, f"≤ {ASKED_SHARE:.0%}", f"{share:.1%}", share <= ASKED_SHARE)
                    )
    return "\n".join(rows)


def verdict(kind: str, what: str, asked: str, measured: str, reached: bool) -> str:
    """A row of `verdicts`."""
    return f"| {kind} | {what} | {asked} | {measured} | {'yes' if reached else '**no**'} |"


def of_many(lines: list[Measured], contender: str, pairs: int = ASKED_PAIRS) -> float | None:
    """Wall seconds of so many pairs: the start once, and the steady rate; of the loop its rate. None: not measured."""
    turns = [line for line in lines if line.contender == contender and line.turn != WHOLE]
    if not turns:
        return None
    if contender == LOOP:
        return pairs * statistics.median(line.wall / line.pairs for line in turns)
    return statistics.median(line.start for line in turns) + pairs * statistics.median(line.steady for line in turns)
