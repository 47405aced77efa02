"""Memory and CPU time of reading a large file in chunks, of reading it whole, and of writing a result of it.

    python -m tests.benchmarks.large_files --folder /tmp/large --points 10000000

makes the files in the folder where they are not there yet, and prints a table. Each row is a process of its own. Memory
is the peak of what is resident beyond what the imports take, and that of the process that decodes LAZ and E57.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from gmmjax.clouds import CloudFile, open_cloud, read_cloud
from gmmjax.reporting.labelled_cloud import LabelledCloud

OFFSET = np.array([500_000.0, 5_400_000.0, 100.0])
ENDINGS = (".laz", ".las", ".ply", ".npy", ".e57")
MEGABYTE = 1 << 20


def parts(count: int, size: int = 1_000_000) -> Iterator[np.ndarray]:
    """A terrain of some millimetres of noise, in the order in which a scanner sees it."""
    for start in range(0, count, size):
        index = np.arange(start, min(start + size, count))
        turn, rise = index * 1e-3, index / count
        reach = 2 + 40 * rise
        noise = np.random.default_rng(start).normal(0, 0.003, (len(index), 3))
        ground = np.stack([reach * np.cos(turn), reach * np.sin(turn), np.sin(reach) + np.cos(3 * turn)], axis=1)
        yield OFFSET + ground + noise


def write_las(path: Path, count: int) -> None:
    """A file of point format 3, LAZ where its ending says so."""
    import laspy

    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = OFFSET, np.full(3, 1e-4)
    with laspy.open(path, mode="w", header=header) as file:
        for points in parts(count):
            record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
            record.x, record.y, record.z = points.T
            record.intensity = (points[:, 0] * 1000 % 4096).astype(np.uint16)
            record.red = record.green = record.blue = record.intensity
            file.write_points(record)


def write_ply(path: Path, count: int) -> None:
    """Coordinates as double, and intensity."""
    kind = np.dtype([("xyz", "<f8", 3), ("intensity", "<u2")])
    names = "".join(f"property double {axis}\n" for axis in "xyz") + "property ushort intensity\n"
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{names}end_header\n"
    with path.open("wb") as file:
        file.write(head.encode())
        for points in parts(count):
            rows = np.zeros(len(points), kind)
            rows["xyz"] = points
            file.write(rows.tobytes())


def write_npy(path: Path, count: int) -> None:
    """Coordinates as double."""
    array = np.lib.format.open_memmap(path, mode="w+", dtype=np.float64, shape=(count, 3))
    start = 0
    for points in parts(count):
        array[start : start + len(points)] = points
        start += len(points)


def write_e57(path: Path, count: int) -> None:
    """A scan for each million points, each at its place."""
    import pye57

    file = pye57.E57(str(path), mode="w")
    for points in parts(count):
        axes = ("cartesianX", "cartesianY", "cartesianZ")
        data = {axis: points[:, index] - OFFSET[index] for index, axis in enumerate(axes)}
        data["intensity"] = np.zeros(len(points), np.float32)
        file.write_scan_raw(data, rotation=np.array([1.0, 0, 0, 0]), translation=OFFSET)
    file.close()


WRITERS: dict[str, Callable[[Path, int], None]] = {
    ".laz": write_las,
    ".las": write_las,
    ".ply": write_ply,
    ".npy": write_npy,
    ".e57": write_e57,
}


def in_chunks(path: Path, out: Path) -> int:
    """All points, in chunks."""
    return sum(len(chunk.points) for chunk in open_cloud(path).chunks())


def whole(path: Path, out: Path) -> int:
    """All points at once, with their fields."""
    return len(read_cloud(path))


def written(path: Path, out: Path) -> int:
    """A result of the file, from results on the disk; moved, as after a registration."""
    file = open_cloud(path)
    found = {name: mapped(out / f"{name}.npy", kind, file) for name, kind in RESULTS.items()}
    motion = np.eye(4)
    motion[:3, 3] = 0.25
    LabelledCloud(file, found, motion).write(out, path.stem)
    return file.count


RESULTS = {"label": "i4", "kind": "u1", "probability": "f4", "unobserved": "u1", "distance": "f4"}


def mapped(path: Path, kind: str, file: CloudFile) -> np.ndarray:
    """A column of results on the disk."""
    return np.lib.format.open_memmap(path, mode="w+", dtype=kind, shape=(file.count,))


WORK = {"in chunks": in_chunks, "whole": whole, "written": written}


def measured(work: str, path: Path, out: Path) -> dict[str, float]:
    """Points, CPU seconds, and the peak of memory of this process and of the one that decodes."""
    baseline, decoder = peak_memory(os.getpid()), Sampler()
    with decoder:
        points = WORK[work](path, out)
    cpu = sum(resource.getrusage(who).ru_utime + resource.getrusage(who).ru_stime for who in WHO) - decoder.cpu_before
    own = peak_memory(os.getpid()) - baseline
    return {"points": points, "cpu": cpu, "own": own, "decoder": decoder.peak}


WHO = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)


def peak_memory(process: int) -> float:
    """Megabytes that were resident at most; 0 where the process has ended."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith("VmHWM")), 0.0)


def command_of(process: int) -> bytes:
    """The command line of a process; nothing where it has ended."""
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return b""


class Sampler(threading.Thread):
    """Looks at the processes that were started, while it is in use as a context.

    Attributes:
        peak: megabytes of the largest.
        cpu_before: CPU seconds that had been used before.
    """

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.peak, self._done = 0.0, threading.Event()
        self.cpu_before = sum(resource.getrusage(who).ru_utime + resource.getrusage(who).ru_stime for who in WHO)

    def __enter__(self) -> "Sampler":
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._done.set()
        self.join()

    def run(self) -> None:
        """Looks at them until the end."""
        while not self._done.wait(0.02):
            for children in Path("/proc/self/task").glob("*/children"):
                for process in children.read_text().split():
                    # Before it runs its own program, a process shows the memory of ours.
                    if b"decoder_main" in command_of(int(process)):
                        self.peak = max(self.peak, peak_memory(int(process)))


def main() -> None:
    """Makes the files, and measures each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--points", type=int, default=10_000_000)
    parser.add_argument("--endings", nargs="+", default=ENDINGS)
    parser.add_argument("--work", nargs="+", default=list(WORK))
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--make", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    command = [sys.executable, "-m", "tests.benchmarks.large_files"]
    command += ["--folder", str(arguments.folder), "--points", str(arguments.points)]
    if arguments.make:
        WRITERS[arguments.make.suffix](arguments.make, arguments.points)
        return
    out = arguments.folder / "out"
    out.mkdir(parents=True, exist_ok=True)
    if arguments.one:
        print(json.dumps(measured(arguments.one[0], Path(arguments.one[1]), out)))
        return
    print("| file | size | | points per CPU second | memory | of the decoder |\n|---|---|---|---|---|---|")
    for ending in arguments.endings:
        path = arguments.folder / f"{arguments.points}{ending}"
        if not path.exists():
            words = [*command, "--make", str(path)]
            subprocess.run(words, check=True)
        for work in arguments.work:
            said = subprocess.run([*command, "--one", work, str(path)], check=True, capture_output=True, text=True)
            own = json.loads(said.stdout)
            rate = own["points"] / own["cpu"] / 1e6
            size = path.stat().st_size / MEGABYTE
            print(
                f"| {ending[1:].upper()} | {size:.0f} MB | {work} | {rate:.1f} million | "
                f"{own['own']:.0f} MB | {own['decoder']:.0f} MB |",
                flush=True,
            )


if __name__ == "__main__":
    main()
