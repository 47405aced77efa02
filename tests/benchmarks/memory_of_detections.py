"""The memory of one process that detects changes in clouds of ever new sizes, and a figure of it.

`python -m tests.benchmarks.memory_of_detections --log run.csv --figure docs/images/benchmarks-memory.svg`

A line of the log is written after each detection, so that a run that was stopped can be drawn with `--draw-only`.
"""

import argparse
import csv
import math
import time
import warnings
from pathlib import Path

import jax
import numpy as np

from tests.benchmarks.scenes import changed_pair, hall_pair
from tests.benchmarks.workers import memory

SMALLEST, LARGEST = 200, 60_000
# Of the resident memory of the process, GB.
ASKED = 1.5
COLUMNS = ("detection", "kind", "points_before", "points_after", "memory_gb", "peak_gb", "programs", "cpu_s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="detections")
    parser.add_argument("--log", type=Path, required=True, help="CSV, a line for each detection")
    parser.add_argument("--figure", type=Path, help="SVG, drawn from the log")
    parser.add_argument("--draw-only", action="store_true", help="draw the log of an earlier run")
    arguments = parser.parse_args()
    if not arguments.draw_only:
        detect(arguments.count, arguments.log)
    if arguments.figure:
        draw(arguments.log, arguments.figure)


def detect(count: int, log: Path) -> None:
    """Detects in scans and volumes in turn; both clouds of a pair have sizes of their own, uniform in the logarithm."""
    from gmmjax import detect_changes

    random = np.random.default_rng(0)
    with log.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for number in range(1, count + 1):
            sizes = np.exp(random.uniform(math.log(SMALLEST), math.log(LARGEST), 2)).astype(int).tolist()
            kind, scene = [("scan", hall_pair), ("volume", changed_pair)][number % 2]
            pair = scene(sizes[0], number, sizes[1])
            with warnings.catch_warnings():
                # Some of the smallest scans have too little in common, which is no matter here.
                warnings.simplefilter("ignore")
                detect_changes(*pair)
            gigabytes = (memory(line) / 1e9 for line in ("VmRSS", "VmHWM"))
            programs = len(jax.devices()[0].client.live_executables())
            writer.writerow([number, kind, *map(len, pair), *gigabytes, programs, time.process_time()])
            file.flush()


def draw(log: Path, figure: Path) -> None:
    """Memory and compiled programs by the number of detections."""
    import matplotlib

    matplotlib.use("agg")
    matplotlib.rcParams["svg.hashsalt"] = "gmmjax"
    import matplotlib.pyplot as plt

    with log.open(newline="") as file:
        rows = list(csv.DictReader(file))
    numbers = [int(row["detection"]) for row in rows]
    canvas, axes = plt.subplots(figsize=(6, 4), layout="constrained")
    axes.plot(numbers, [float(row["memory_gb"]) for row in rows], label="resident memory")
    axes.axhline(ASKED, color="grey", linestyle="--", label="asked")
    axes.set(xlabel=f"detections, {SMALLEST:,} to {LARGEST:,} points a cloud", ylabel="GB", ylim=(0, ASKED * 1.1))
    axes.grid(alpha=0.3)
    programs = axes.twinx()
    programs.plot(numbers, [int(row["programs"]) for row in rows], color="tab:orange", label="compiled programs")
    programs.set(ylabel="programs", ylim=(0, None))
    lines = [*axes.get_lines(), *programs.get_lines()]
    axes.legend(lines, [line.get_label() for line in lines], loc="lower right")
    canvas.savefig(figure, metadata={"Date": None})
    plt.close(canvas)


if __name__ == "__main__":
    main()
