"""What a detection costs by the size of the scans: `python -m tests.benchmarks.detections --page docs/benchmarks.md`.

CPU and wall seconds of a warm detection with default settings and the CPU seconds of its stages, its peak of memory in
a new process, compilation included, and the number of changes. `--against CHECKOUT` runs another version on the same
pairs, in turns: a worktree of an earlier commit with its kernels compiled (`python setup.py build_ext --inplace`
there). `--many N` tells the memory of a process that detects in N pairs of ever new sizes.
"""

import itertools
import json
import math
import os
import statistics
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.clouds import changed_pair, hall_pair
from tests.benchmarks.harness import Line, Log, memory, options, put, run, seconds, table, worker

COLUMNS = ("scans", "points", "version", "CPU", "wall", "memory", "changes", "load")
# Where the CPU time goes: what the progress says at the beginning of each stage.
STAGES = {
    "Reading the scales of the clouds": "check",
    "Registering the clouds": "register, reduce, stations",
    "Fitting the mixtures": "fit",
    "Looking for changes": "differences, candidates, evidence",
    "Looking for moved objects": "moved objects, volumes, distances",
}
TABLE = "table, depth camera"
# Warm detections of a process.
REPEATS = "2"
HERE = Path(__file__).resolve().parents[2]
# Both clouds of a pair of `--many` have sizes of their own, uniform in the logarithm.
SMALLEST, LARGEST = 200, 60_000


def room(quick: bool) -> tuple[np.ndarray, np.ndarray]:
    from tests.benchmarks.held_out import held_out_pair

    pair = held_out_pair("turned_chair" if quick else "room", 20, True, "unknown")
    step = 10 if quick else 1
    return pair.before.points[::step], pair.after.points[::step]


def real_table(quick: bool) -> tuple[np.ndarray, np.ndarray]:
    """A real table by a depth camera, 170,000 points a side."""
    from gmmjax import read_cloud

    folder = Path(os.environ["GMMJAX_DATA"]) / "pairs" / "mosd_test44_47"
    before, after = (read_cloud(folder / f"{side}.ply").points for side in ("before", "after"))
    return before[:: 50 if quick else 1], after[:: 50 if quick else 1]


SCANS: dict[str, Callable[[bool], tuple[np.ndarray, np.ndarray]]] = {
    "hall, 2 boxes": lambda quick: hall_pair(2_000 if quick else 50_000),
    "held-out room": room,
    TABLE: real_table,
    "hall, a million points": lambda quick: hall_pair(3_000 if quick else 1_000_000),
}


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--scans", nargs="+", choices=SCANS, default=list(SCANS))
    parser.add_argument("--no-commands", action="store_true", help="leaves out `gmmjax detect`")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--against", type=Path, help="root of another checkout")
    parser.add_argument("--many", type=int, default=0, help="detections in one process; its memory is told")
    arguments = parser.parse_args()
    if "GMMJAX_DATA" not in os.environ:
        arguments.scans = [name for name in arguments.scans if name != TABLE]
    log, rows = Log(arguments.log), []
    versions = {"this": HERE} | ({str(arguments.against): arguments.against.resolve()} if arguments.against else {})
    lines: dict[tuple[str, str], list[Line]] = {}
    for turn, name, version in itertools.product(range(arguments.turns), arguments.scans, versions):
        key = {"scans": name, "version": version, "quick": arguments.quick, "turn": turn}
        line = log.measure(key, lambda n=name, v=version: in_new_process(n, versions[v], arguments.quick))
        lines.setdefault((name, version), []).append(line)
    rows += [row(*key, group) for key, group in sorted(lines.items())]
    if not arguments.no_commands:
        for state in ("cold", "warm"):
            line = log.measure({"scans": state, "quick": arguments.quick}, lambda s=state: command(s, arguments.quick))
            rows.append(row(f"gmmjax detect, {state} cache", "this", [line]))
    if arguments.many:
        line = log.measure({"scans": "many", "number": arguments.many}, lambda: many(arguments.many))
        rows.append(row(f"{arguments.many} detections in one process, at their end", "this", [line]))
    put(arguments.page, "detections", table(COLUMNS, rows))
    stages = [[name, *stage_cells(group)] for (name, version), group in sorted(lines.items()) if version == "this"]
    put(arguments.page, "stages", table(("scans", *STAGES.values()), stages))


def row(name: str, version: str, lines: Sequence[Line]) -> list[str]:
    """Medians over the turns."""
    cpu, wall, most = (statistics.median(line[part] for line in lines) for part in ("cpu", "wall", "memory"))
    cells = [lines[0]["points"], version, seconds(cpu), seconds(wall), f"{most:.2f} GB"]
    return [name, *cells, str(lines[0]["changes"]), f"{max(line['load'] for line in lines):.1f}"]


def stage_cells(lines: Sequence[Line]) -> list[str]:
    """The medians over the turns of the CPU time of each stage, in a warm detection."""
    return [seconds(statistics.median(line["stages"].get(stage, 0.0) for line in lines)) for stage in STAGES]


def in_new_process(name: str, root: Path, quick: bool) -> dict[str, Any]:
    """The cost of one pair in the package of a checkout."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pair.npz"
        before, after = SCANS[name](quick)
        np.savez(file, before=before, after=after)
        done = run(["-P", str(HERE / "tests/benchmarks/detect_there.py"), str(file), REPEATS], PYTHONPATH=str(root))
    found = json.loads(done.answer.splitlines()[-1])
    if not Path(found.pop("package")).is_relative_to(root):
        sys.exit(f"{root} is no checkout of gmmjax")
    return {"points": f"{len(before):,} and {len(after):,}", **found}


def command(state: str, quick: bool) -> dict[str, Any]:
    """`gmmjax detect` on two PLY files, start and report included; the cache of compiled programs is empty or not."""
    from gmmjax.clouds import write_ply

    size = 1_000 if quick else 50_000
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for side, points in zip(("before", "after"), hall_pair(size), strict=True):
            write_ply(place / f"{side}.ply", points)
        words = ["-m", "gmmjax", "detect", str(place / "before.ply"), str(place / "after.ply")]
        words += ["--out", str(place / "out"), "--overwrite", "--quiet"]
        done = [run(words, XDG_CACHE_HOME=str(place / "cache")) for _ in range(2 if state == "warm" else 1)][-1]
    return {"points": f"2 x {size:,}", "cpu": done.cpu, "wall": done.wall, "memory": done.memory, "changes": ""}


def many(number: int) -> dict[str, Any]:
    """Resident memory after so many detections in scans and volumes in turn, of ever new sizes, in one process."""
    with worker() as there:
        done = there(_many, number)
    sizes = f"{SMALLEST:,} to {LARGEST:,}"
    return {"points": sizes, "cpu": done.cpu, "wall": done.wall, "memory": done.answer / 1e9, "changes": ""}


def _many(number: int) -> int:
    from gmmjax import detect_changes

    random = np.random.default_rng(0)
    for nth in range(number):
        sizes = np.exp(random.uniform(math.log(SMALLEST), math.log(LARGEST), 2)).astype(int).tolist()
        with warnings.catch_warnings():
            # Some of the smallest scans have too little in common, which is no matter here.
            warnings.simplefilter("ignore")
            detect_changes(*(hall_pair, changed_pair)[nth % 2](sizes[0], nth, sizes[1]))
    return memory("VmRSS")


if __name__ == "__main__":
    main()
