"""The resident memory of all processes of one batch run, sampled while it runs, and a figure of it."""

import csv
import os
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

from tests.benchmarks.memory_of_detections import ASKED, LARGEST, SMALLEST

COLUMNS = ("seconds", "done", "pid", "role", "memory_gb", "peak_gb")
# Helpers of Python's multiprocessing, a few MB each.
LEAST_GB = 0.1


def run(manifest: Path, out: Path, log: Path, words: list[str], every: float) -> None:
    """Runs `gmmjax batch`, or goes on with it, and adds a line to the log for each process and sample.

    Raises:
        SystemExit: the run failed.
    """
    begins = not log.exists()
    with log.open("a", newline="") as file:
        writer = csv.writer(file)
        if begins:
            writer.writerow(COLUMNS)
        started = time.monotonic()
        command = [sys.executable, "-m", "gmmjax", "batch", str(manifest), "--out", str(out), *words, "--quiet"]
        driver = subprocess.Popen(command)
        while driver.poll() is None:
            done = number_done(out)
            for pid, role in processes(driver.pid).items():
                if gigabytes := memory_of(pid):
                    writer.writerow([f"{time.monotonic() - started:.1f}", done, pid, role, *gigabytes])
            file.flush()
            time.sleep(every)
    if driver.returncode:
        raise SystemExit(f"the run ended with {driver.returncode}; start it again to go on")


def number_done(out: Path) -> int:
    """Pairs of the run that are done."""
    folder = out / "pairs"
    return sum(1 for entry in os.scandir(folder) if not entry.name.startswith(".")) if folder.is_dir() else 0


def processes(driver: int) -> dict[int, str]:
    """The driver and all that it started, by their roles; those that end meanwhile are left out."""
    children = defaultdict(list)
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and (parent := parent_of(entry)) is not None:
            children[parent].append(int(entry.name))
    found, waiting = {driver: "driver"}, [driver]
    while waiting:
        for pid in children[waiting.pop()]:
            found[pid] = "worker"
            waiting.append(pid)
    return found


def parent_of(process: Path) -> int | None:
    """From the system's own table; None: it has ended."""
    try:
        # The name, in brackets, may hold anything.
        return int((process / "stat").read_text().rpartition(")")[2].split()[1])
    except (OSError, IndexError):
        return None


def memory_of(pid: int) -> tuple[float, float] | None:
    """Resident memory of a process and its peak, GB; None: it has ended, or is one of Python's small helpers."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return None
    sizes = {line.split(":")[0]: line.split()[1] for line in lines if line.startswith(("VmRSS", "VmHWM"))}
    if len(sizes) < 2 or int(sizes["VmHWM"]) / 1e6 < LEAST_GB:
        return None
    return 1.024e-6 * int(sizes["VmRSS"]), 1.024e-6 * int(sizes["VmHWM"])


def read(log: Path) -> dict[tuple[str, str], list[dict[str, str]]]:
    """The samples of each process, by role and number, in the order in which they began."""
    samples = defaultdict(list)
    with log.open(newline="") as file:
        for row in csv.DictReader(file):
            samples[row["role"], row["pid"]].append(row)
    return dict(samples)


def summary(log: Path) -> str:
    """A row for each process: its memory early, in the middle and in the end, and its peak."""
    lines = ["| process | pairs of the run | a quarter on | half on | in the end | peak |", "|---|---|---|---|---|---|"]
    for (role, _), rows in read(log).items():
        pairs = f"{rows[0]['done']} to {rows[-1]['done']}"
        at = [rows[int(share * (len(rows) - 1))]["memory_gb"] for share in (0.25, 0.5, 1)]
        cells = [role, pairs, *(f"{float(own):.2f} GB" for own in (*at, rows[-1]["peak_gb"]))]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def draw(log: Path, figure: Path) -> None:
    """The memory of the driver and of every worker by the number of pairs done."""
    import matplotlib

    matplotlib.use("agg")
    matplotlib.rcParams["svg.hashsalt"] = "gmmjax"
    import matplotlib.pyplot as plt

    canvas, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    workers = 0
    for (role, _), rows in read(log).items():
        workers += role == "worker"
        label = f"worker {workers}" if role == "worker" else role
        style = {} if role == "worker" else {"color": "black"}
        done, memory = ([float(row[column]) for row in rows] for column in ("done", "memory_gb"))
        axes.plot(done, memory, label=label, linewidth=0.8, **style)
    axes.axhline(ASKED, color="grey", linestyle="--", label="asked of a worker")
    axes.set(xlabel=f"pairs done, {SMALLEST:,} to {LARGEST:,} points a cloud", ylabel="GB", ylim=(0, ASKED * 1.1))
    axes.grid(alpha=0.3)
    canvas.legend(loc="outside upper center", ncols=4)
    canvas.savefig(figure, metadata={"Date": None})
    plt.close(canvas)


if __name__ == "__main__":
    raise SystemExit("use `python -m tests.benchmarks.batch_runs memory`")
