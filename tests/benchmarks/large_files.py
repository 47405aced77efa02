"""Time and memory of large scans: `python -m tests.benchmarks.large_files --folder /tmp/large --points 10000000`.

Makes two LAZ and LAS files in the folder where they are not there yet: a hall, whose after scan has a box more. A
row for reading in chunks, reading whole, and for `gmmjax detect` on the LAZ files, each in a process of its own; memory
is the peak of all its processes beyond what the imports take, what they share counted once.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds import open_cloud, read_cloud
from tests.benchmarks.harness import Log, options, put, run, table

COLUMNS = ("file", "points", "", "wall", "CPU", "points per CPU second", "memory", "load")
OFFSET = np.array([500_000.0, 5_400_000.0, 100.0])
STEP = 1_000_000


def parts(count: int, boxes: int) -> Iterator[np.ndarray]:
    """A floor and two walls of 40 m with 3 mm of noise and some boxes of 1 m, a million points at a time."""
    for start in range(0, count, STEP):
        size, random = min(STEP, count - start), np.random.default_rng([start, boxes])
        points = random.uniform(0, 40, (size, 3)) * (1, 1, 0.15)
        which = np.arange(size) % 4
        for axis in range(3):
            rows = which == axis
            points[rows, axis] = 0.003 * random.standard_normal(rows.sum())
        rows = np.flatnonzero(which == 3)
        rows = rows[: len(rows) // 10 * boxes]
        sides = random.uniform(0, 1, (len(rows), 3))
        sides[np.arange(len(rows)), rows % 3] = 1
        points[rows] = sides + (10, 10, 0) + (rows % boxes)[:, None] * np.array([8.0, 5.0, 0.0])
        points[which == 3, 2] = np.abs(points[which == 3, 2])
        yield OFFSET + points


def write_las(path: Path, count: int, boxes: int) -> None:
    """LAS or LAZ, as its ending says."""
    import laspy

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.offsets, header.scales = OFFSET, np.full(3, 1e-4)
    with laspy.open(path, mode="w", header=header) as file:
        for points in parts(count, boxes):
            record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
            record.x, record.y, record.z = points.T
            file.write_points(record)


def in_chunks(path: Path) -> int:
    """All points, in chunks."""
    return sum(len(chunk.points) for chunk in open_cloud(path).chunks())


def whole(path: Path) -> int:
    """All points at once, with their fields."""
    return len(read_cloud(path))


READ = {"in chunks": in_chunks, "whole": whole, "imports alone": lambda path: 0}


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--points", type=int, nargs="+", default=[10_000_000])
    parser.add_argument("--endings", nargs="+", choices=(".laz", ".las"), default=[".laz", ".las"])
    parser.add_argument("--workers", default="2", help="of gmmjax detect")
    parser.add_argument("--read", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.read:
        READ[arguments.read[0]](Path(arguments.read[1]))
        return
    log, rows = Log(arguments.log), []
    for count in arguments.points:
        for ending in arguments.endings:
            files = [made(arguments.folder, count, ending, boxes) for boxes in (1, 2)]
            for work in ("in chunks", "whole", *(["gmmjax detect"] if ending == ".laz" else [])):
                key = {"points": count, "ending": ending, "work": work}
                line = log.measure(key, lambda w=work, f=files: measured(w, f, arguments.folder, arguments.workers))
                rate = count * (2 if work == "gmmjax detect" else 1) / line["cpu"] / 1e6
                cells = [f"{line['wall']:.0f} s", f"{line['cpu']:.0f} s", f"{rate:.2g} million"]
                rows.append([ending[1:].upper(), f"{count:,}", work, *cells, f"{line['memory']:.2f} GB", line["load"]])
    put(arguments.page, "large files", table(COLUMNS, rows))


def made(folder: Path, count: int, ending: str, boxes: int) -> Path:
    """A file, written if it is not there yet."""
    path = folder / f"{count}-{boxes}{ending}"
    if not path.exists():
        write_las(path, count, boxes)
    return path


def measured(work: str, files: list[Path], folder: Path, workers: str) -> dict[str, Any]:
    """Time of one command, and the peak of memory of all its processes over that of the imports."""
    if work == "gmmjax detect":
        words = ["-m", "gmmjax", "detect", *map(str, files), "--out", str(folder / "out"), "--overwrite", "--quiet"]
        words += ["--workers", workers]
        idle = 0.0
    else:
        words = ["-m", "tests.benchmarks.large_files", "--folder", str(folder), "--read", work, str(files[0])]
        idle = peak([*words[:-2], "imports alone", words[-1]])
    done = run(words)
    return {"wall": done.wall, "cpu": done.cpu, "memory": peak(words) - idle}


def peak(words: list[str]) -> float:
    """Memory of a Python command and all that it started, at most, GB."""
    process, most = subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL), 0.0
    while process.poll() is None:
        most = max(most, sum(map(_memory, _tree(process.pid))))
        time.sleep(0.05)
    if process.returncode:
        raise SystemExit(f"{' '.join(words)}: failed")
    return most


def _tree(pid: int) -> list[int]:
    """A process and all that it started."""
    found = [pid]
    for own in found:
        for children in Path(f"/proc/{own}/task").glob("*/children"):
            try:
                found += map(int, children.read_text().split())
            # It has ended.
            except OSError:
                continue
    return found


def _memory(pid: int) -> float:
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(1.024e-6 * int(line.split()[1]) for line in lines if line.startswith("Pss:"))


if __name__ == "__main__":
    main()
