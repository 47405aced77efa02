"""`gmmjax batch` beside a loop over `gmmjax detect`: `python -m tests.benchmarks.batch --log batch.jsonl`.

Pairs of two kinds: `gaussians`, 2 x 5,000 points, and `rooms`, scans of 2 x 20,000 points of simulated rooms, tables
and halls. Each turn gives all contenders the same pairs, other ones than the turn before. The first run computes all
pairs once, so that the cache has all programs.
"""

import csv
import itertools
import os
import statistics
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.clouds import write_ply
from gmmjax.evaluation import family_sources
from gmmjax.pair import Pair
from tests.benchmarks.clouds import changed_pair
from tests.benchmarks.harness import Line, Log, options, put, run, seconds, table

COLUMNS = ("pairs", "contender", "runs x pairs", "wall a pair", "CPU a pair", "pairs an hour", "load")
FAMILIES, POINTS = ("rooms", "tabletop", "halls"), 20_000
LOOP, ONE, ALL = "loop over detect", "batch, one core", "batch, all cores"
Clouds = Pair[np.ndarray]


def gaussians(seed: int) -> Clouds:
    """2 x 5,000 points of five Gaussians, of which one goes and another comes."""
    return Pair(*changed_pair(5_000, seed))


def rooms(seed: int) -> Clouds:
    """Scans of a room, a table or a hall, in turn; 20,000 points a cloud or what there is, without poses."""
    pair = family_sources([FAMILIES[seed % len(FAMILIES)]], [seed], poses="unknown")[0].load()
    random = np.random.default_rng(seed)
    sides = Pair(pair.before.points, pair.after.points)
    return sides.map(lambda points: points[np.sort(random.permutation(len(points))[:POINTS])])


KINDS: dict[str, Callable[[int], Clouds]] = {"gaussians": gaussians, "rooms": rooms}


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--pairs", type=int, default=20, help="of a turn")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--restarts", type=int, default=16)
    arguments = parser.parse_args()
    log, groups = Log(arguments.log), {}
    with tempfile.TemporaryDirectory() as folder:
        cache = str(Path(folder) / "cache")
        for kind in arguments.kinds:
            seeds = range(arguments.pairs * arguments.turns)
            written = [_written(Path(folder), kind, seed) for seed in seeds]
            computed(ALL, written, arguments.restarts, cache)
            for turn, contender in itertools.product(range(arguments.turns), (ALL, ONE, LOOP)):
                own = written[turn * arguments.pairs : (turn + 1) * arguments.pairs]
                key = {"kind": kind, "contender": contender, "turn": turn, "pairs": len(own)}
                line = log.measure(key, lambda c=contender, own=own: computed(c, own, arguments.restarts, cache))
                groups.setdefault((kind, contender), []).append(line)
    put(arguments.page, "batch", table(COLUMNS, [row(*key, lines) for key, lines in groups.items()]))


def computed(contender: str, pairs: Sequence[Sequence[str]], restarts: int, cache: str) -> dict[str, Any]:
    """Wall and CPU seconds of a contender in an empty folder, its start included."""
    cores = sorted(os.sched_getaffinity(0))[: 1 if contender == ONE else None]
    given = ["--restarts", str(restarts), "--quiet"]
    with tempfile.TemporaryDirectory() as folder:
        manifest, out = Path(folder) / "manifest.csv", Path(folder) / "out"
        with manifest.open("w", newline="") as file:
            csv.writer(file).writerows([("name", "before", "after"), *pairs])
        calls = [["batch", str(manifest), "--out", str(out), "--workers", str(len(cores))]]
        if contender == LOOP:
            calls = [["detect", before, after, "--out", str(out / name)] for name, before, after in pairs]
        done = [run(["-m", "gmmjax", *words, *given], cores, XDG_CACHE_HOME=cache) for words in calls]
    return {"wall": sum(own.wall for own in done), "cpu": sum(own.cpu for own in done)}


def row(kind: str, contender: str, lines: Sequence[Line]) -> list[str]:
    """Medians over the turns."""
    wall, cpu = (statistics.median(line[part] / line["pairs"] for line in lines) for part in ("wall", "cpu"))
    cells = [kind, contender, f"{len(lines)} x {lines[0]['pairs']}", seconds(wall), seconds(cpu)]
    return [*cells, f"{3600 / wall:,.0f}", f"{max(line['load'] for line in lines):.1f}"]


def _written(folder: Path, kind: str, seed: int) -> list[str]:
    """Name, before and after of a pair, written as PLY files."""
    clouds = KINDS[kind](seed)
    files = [folder / f"{kind}-{seed}-{side}.ply" for side in ("before", "after")]
    for file, cloud in zip(files, clouds, strict=True):
        write_ply(file, cloud)
    return [f"{kind}-{seed}", *map(str, files)]


if __name__ == "__main__":
    main()
