"""What a detection costs in this checkout and in another one: `python -m tests.benchmarks.checkouts --against FOLDER`.

Two processes, one for each checkout, detect the changes of the same pairs in turns; the first turn of a pair compiles
and is not counted, CPU seconds are the median of the others. `same` says whether both gave the same record, facts
included, and the same values of all points, bit for bit. Real pairs are those of the folder GMMJAX_DATA, left out
where it is not set.

The other checkout is a worktree of an earlier commit (`git worktree add FOLDER COMMIT`), with its kernels compiled
(`python setup.py build_ext --inplace` there).
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from gmmjax import SensorViews, read_cloud, read_views
from gmmjax.scenes import laboratory_scene
from tests.benchmarks.held_out.kinds import held_out_pair
from tests.benchmarks.interleaved import Elsewhere, Interleaved, Timing, load
from tests.benchmarks.scenes import hall_pair

HERE = Path(__file__).resolve().parents[2]
PROCESS = Path(__file__).with_name("checkout_process.py")
# Kinds of held-out scenes with about 50,000 points a cloud, few and many candidates, indoors and outdoors.
HELD_OUT = ("corridor", "station", "street", "airborne", "laid_table", "turned_chair", "pulled_drawer", "half_overlap")
TIMES = "before", "after"


class PairOfScans(NamedTuple):
    """Two clouds, and the views of both or of neither."""

    clouds: tuple[np.ndarray, np.ndarray]
    views: tuple[SensorViews, SensorViews] | None = None

    def save(self, path: Path) -> None:
        """Writes it for `checkout_process`."""
        arrays = dict(zip(TIMES, self.clouds, strict=True))
        for name, views in zip(TIMES, self.views or (), strict=False):
            arrays[f"poses_{name}"] = views.poses
            arrays[f"sensor_{name}"] = np.array([*views.field_of_view, views.max_range])
        np.savez(path, **arrays)


def pairs() -> dict[str, Callable[[], PairOfScans]]:
    """All pairs by name; each is made when it is its turn."""
    made = {"hall": lambda: PairOfScans(hall_pair(50_000)), "laboratory": laboratory}
    for kind in HELD_OUT:
        made[kind] = lambda kind=kind: held_out(kind)._replace(views=None)
        made[f"{kind}, poses"] = lambda kind=kind: held_out(kind)
    folder = Path(os.environ.get("GMMJAX_DATA", "")) / "pairs"
    for pair in sorted(folder.iterdir()) if os.environ.get("GMMJAX_DATA") and folder.is_dir() else []:
        made[pair.name] = lambda pair=pair: real(pair)._replace(views=None)
        if (pair / "views_before.json").exists():
            made[f"{pair.name}, poses"] = lambda pair=pair: real(pair)
    return made


def laboratory() -> PairOfScans:
    scene = laboratory_scene(jax.random.key(0), appeared=1, disappeared=1)
    return PairOfScans((scene.before, scene.after))


def held_out(kind: str) -> PairOfScans:
    pair = held_out_pair(kind, 0, changed=True)
    return PairOfScans((pair.before.points, pair.after.points), (pair.before.views, pair.after.views))


def real(folder: Path) -> PairOfScans:
    clouds = tuple(read_cloud(folder / f"{time}.ply").points for time in TIMES)
    files = [folder / f"views_{time}.json" for time in TIMES]
    return PairOfScans(clouds, tuple(map(read_views, files)) if all(file.exists() for file in files) else None)


@contextlib.contextmanager
def process(checkout: Path, script: Path = PROCESS, **variables: str) -> Iterator[Callable[[object], Elsewhere]]:
    """A process that computes with the package of a checkout: call it with a line that its script understands.

    The script first writes where it has the package from, and then an answer for each line, with its `wall` and `cpu`.
    """
    threads = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
    environment = {**os.environ, **threads, **variables, "PYTHONPATH": str(checkout)}
    # -P: the folder of the script is not on the path, the checkout is.
    command = [sys.executable, "-P", str(script)]
    with subprocess.Popen(
        command, cwd=checkout, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as running:
        answers = iter(running.stdout)
        package = Path(json.loads(next(answers, "null") or "null") or "nowhere")
        if not package.is_relative_to(checkout):
            raise SystemExit(f"{checkout} is no checkout of gmmjax: the package was imported from {package}")

        def ask(question: object) -> Elsewhere:
            print(question, file=running.stdin, flush=True)
            line = next(answers, None)
            if line is None:
                raise SystemExit(f"the process of {checkout} ended; what it said stands above")
            found = json.loads(line)
            return Elsewhere(found["wall"], found["cpu"], found)

        yield ask
        running.stdin.close()


def compared(
    own: Callable[[Path], Elsewhere], other: Callable[[Path], Elsewhere], pair: PairOfScans, repeats: int
) -> dict[str, Timing]:
    """One pair by both, in turns."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "pair.npz"
        pair.save(file)
        turns = Interleaved({"other": lambda: other(file), "own": lambda: own(file)})
        for _ in range(repeats + 1):
            turns.turn()
    return turns.timings


COLUMNS = "pair", "points", "other, s", "this, s", "ratio", "found by other", "found by this", "same", "load"
HEADER = f"| {' | '.join(COLUMNS)} |\n" + "|---" * len(COLUMNS) + "|"


def row(name: str, pair: PairOfScans, timings: dict[str, Timing], load: float) -> str:
    """A line of the table."""
    other, own = timings["other"], timings["own"]
    found = [", ".join(f"{n} {kind}" for kind, n in t.answer["kinds"].items()) or "nothing" for t in (other, own)]
    same = "yes" if own.answer["digest"] == other.answer["digest"] else "no"
    points = " and ".join(f"{len(cloud):,}" for cloud in pair.clouds)
    seconds = f"{other.cpu:.2f} | {own.cpu:.2f} | {own.cpu / other.cpu:.2f}"
    return f"| {name} | {points} | {seconds} | {found[0]} | {found[1]} | {same} | {load:.1f} |"


def main() -> None:
    arguments = parsed_arguments()
    chosen = {name: make for name, make in pairs().items() if any(part in name for part in arguments.only)}
    if not chosen:
        raise SystemExit(f"no pair's name contains {' or '.join(arguments.only)}; GMMJAX_DATA names real scans")
    print(HEADER, flush=True)
    with process(arguments.against.resolve()) as other, process(HERE) as own:
        for name, make in chosen.items():
            pair = make()
            before = load()
            timings = compared(own, other, pair, arguments.repeats)
            print(row(name, pair, timings, max(before, load())), flush=True)


def parsed_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, required=True, metavar="FOLDER", help="the other checkout")
    parser.add_argument("--repeats", type=int, default=5, help="counted turns")
    parser.add_argument("--only", nargs="+", default=[""], help="pairs whose name contains one of these")
    arguments = parser.parse_args()
    if arguments.repeats < 1:
        parser.error("--repeats must be at least 1")
    if not (arguments.against / "gmmjax" / "__init__.py").is_file():
        parser.error(f"--against {arguments.against}: there is no package gmmjax in it")
    return arguments


if __name__ == "__main__":
    main()
