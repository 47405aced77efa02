"""Time and memory of `gmmjax detect` on files of ever more points, as processes of their own, and a figure of both."""

import csv
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import laspy
import numpy as np

from gmmjax.pair import Pair
from tests.benchmarks.batch_memory import processes
from tests.benchmarks.surveyor.large import write_large


class Cost(NamedTuple):
    """What one run took.

    Attributes:
        points: of both files.
        options: that it was given.
        wall: seconds from its start to its end.
        cpu: seconds of all its processes.
        memory: of all its processes at one time, at the most, GB; what they share is counted once.
        code: that it ended with.
    """

    points: int
    options: str
    wall: float
    cpu: float
    memory: float
    code: int


def scaling(sizes: Sequence[int], folder: Path, log: Path, options: Sequence[str], kind: str) -> None:
    """Runs the command line on each size and adds a line to the log for each run.

    Args:
        sizes: points a side.
        folder: of the files, which are written where they are not there yet, and of the results.
        log: CSV; lines of earlier runs are kept.
        options: of `gmmjax detect`, but for `--out`.
        kind: of the scenes.
    """
    begins = not log.exists()
    with log.open("a", newline="") as file:
        writer = csv.writer(file)
        if begins:
            writer.writerow(Cost._fields)
        for size in sizes:
            paths = Pair(*(folder / f"{kind}_{size}_{side}.laz" for side in ("before", "after")))
            if not all(path.exists() for path in paths):
                write_large(paths, size, kind)
            cost = measured(paths, folder / "result", options)
            writer.writerow(cost)
            file.flush()
            print(cost, file=sys.stderr, flush=True)


def measured(paths: Pair[Path], out: Path, options: Sequence[str]) -> Cost:
    """One run of the command line."""
    words = [sys.executable, "-m", "gmmjax", "detect", *map(str, paths), "--out", str(out), "--overwrite", "--quiet"]
    start = time.monotonic()
    run = subprocess.Popen([*words, *options])
    peak, seconds = 0.0, {}
    while (ended := os.wait4(run.pid, os.WNOHANG))[0] == 0:
        memory, own = _tree(run.pid)
        peak = max(peak, memory)
        seconds.update(own)
        time.sleep(0.2)
    wall, (_, status, usage) = time.monotonic() - start, ended
    run.returncode = os.waitstatus_to_exitcode(status)
    # Workers that end before the run are in its usage, those that somebody else waited for only in the samples.
    cpu = max(usage.ru_utime + usage.ru_stime, sum(seconds.values()))
    return Cost(sum(map(_count, paths)), " ".join(options), wall, cpu, peak, run.returncode)


def table(log: Path) -> str:
    """A row for each run."""
    rows = [("points of both", "options", "wall", "CPU", "CPU per million points", "peak memory")]
    rows.append(("---",) * len(rows[0]))
    for cost in read(log):
        millions = cost.points / 1e6
        rows.append(
            (
                f"{millions:,.1f} million",
                f"`{cost.options}`" if cost.options else "",
                f"{cost.wall:.0f} s" + (f" (ended with {cost.code})" if cost.code else ""),
                f"{cost.cpu:.0f} s",
                f"{cost.cpu / millions:.2f} s",
                f"{cost.memory:.2f} GB",
            )
        )
    return "\n".join(f"| {' | '.join(row)} |" for row in rows) + "\n"


def draw(log: Path, figure: Path) -> None:
    """Time and memory by the number of points, with the straight line that fits the CPU time best."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    costs = [cost for cost in read(log) if not cost.code]
    canvas, (times, memory) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for options in dict.fromkeys(cost.options for cost in costs):
        own = sorted((cost for cost in costs if cost.options == options), key=lambda cost: cost.points)
        millions = [cost.points / 1e6 for cost in own]
        curve = times.plot(millions, [cost.cpu for cost in own], "o-", label=f"CPU {options}".strip())[0]
        times.plot(
            millions, [cost.wall for cost in own], "o:", color=curve.get_color(), label=f"wall {options}".strip()
        )
        memory.plot(millions, [cost.memory for cost in own], "o-", color=curve.get_color(), label=options or None)
    slope, fixed = np.polyfit([cost.points / 1e6 for cost in costs], [cost.cpu for cost in costs], 1)
    ends = np.array([0, max(cost.points for cost in costs) / 1e6])
    line = f"CPU = {fixed:.0f} s + {slope:.2f} s per million points"
    times.plot(ends, fixed + slope * ends, color="grey", linestyle="--", label=line)
    times.set(xlabel="points of both scans, million", ylabel="seconds", xlim=(0, None), ylim=(0, None))
    memory.set(xlim=(0, None), xlabel="points of both scans, million", ylabel="peak memory, GB", ylim=(0, None))
    for axes in (times, memory):
        axes.grid(alpha=0.3)
    times.legend(fontsize="small")
    if any(cost.options for cost in costs):
        memory.legend(fontsize="small")
    canvas.savefig(figure, dpi=150)
    plt.close(canvas)


def read(log: Path) -> list[Cost]:
    """The runs of a log."""
    with log.open(newline="") as file:
        return [
            Cost(
                int(row["points"]),
                row["options"],
                *(float(row[name]) for name in ("wall", "cpu", "memory")),
                int(row["code"]),
            )
            for row in csv.DictReader(file)
        ]


def _tree(pid: int) -> tuple[float, dict[int, float]]:
    """Memory of a process and all that it started, GB, and the CPU seconds of each."""
    memory, seconds = 0.0, {}
    for own in processes(pid):
        try:
            rollup = Path(f"/proc/{own}/smaps_rollup").read_text()
            # The name, in brackets, may hold anything.
            ticks = Path(f"/proc/{own}/stat").read_text().rpartition(")")[2].split()[11:13]
        # It has ended.
        except OSError:
            continue
        memory += sum(1.024e-6 * int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:"))
        seconds[own] = sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")
    return memory, seconds


def _count(path: Path) -> int:
    with laspy.open(path) as file:
        return int(file.header.point_count)
