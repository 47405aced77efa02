"""What surveyors ask of a comparison of two scans, measured: `python -m tests.benchmarks.surveyor COMMAND`."""

import argparse
import shlex
from pathlib import Path
from typing import get_args

import numpy as np

from gmmjax.pair import Pair
from tests.benchmarks.page import conditions
from tests.benchmarks.surveyor.accuracy import Job, Views, accuracy, to_markdown
from tests.benchmarks.surveyor.files import write_scene
from tests.benchmarks.surveyor.found import found_in_large
from tests.benchmarks.surveyor.kinds import GRID, HELD_OUT, KINDS, drawn_from, kind_of, simulated
from tests.benchmarks.surveyor.large import copies_of, write_large
from tests.benchmarks.surveyor.surveys import surveyed


def main() -> None:
    options = parser()
    arguments = options.parse_args()
    if arguments.out and not arguments.out.resolve().parent.is_dir():
        options.error(f"--out {arguments.out}: there is no folder {arguments.out.parent}")
    arguments.run(arguments)


def parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = result.add_subparsers(required=True, metavar="COMMAND")
    own = commands.add_parser("accuracy", help="segment F1 and point F1, and false segments where nothing changed")
    _scenes(own)
    own.add_argument("--views", choices=("given", "unknown", "both"), default="both", help="the stations' poses")
    own.add_argument("--peers", choices=("with", "without", "only"), default="without", help="at their best setting")
    own.add_argument("--verdict", help="file that gmmjax tune wrote, in place of ours")
    own.add_argument("--out", type=Path, help="file that the table is written to")
    own.set_defaults(run=run_accuracy)
    own = commands.add_parser("write", help="a folder of pairs, as gmmjax tune reads them")
    _scenes(own)
    own.add_argument("--unchanged", action="store_true", help="the twins in which nothing changed")
    own.add_argument("--out", type=Path, required=True, help="folder")
    own.set_defaults(run=run_write)
    own = commands.add_parser("make-large", help="two LAZ files of any number of points, written in parts")
    own.add_argument("paths", nargs=2, type=Path, metavar="FILE", help="before and after, .laz or .las")
    own.add_argument("--points", type=int, default=20_000_000, help="about so many a side")
    own.add_argument("--kind", choices=list(KINDS), default="hall")
    own.add_argument("--seed", type=int, default=0)
    own.add_argument("--copies", type=int, default=1, help="of the scene, side by side, with their share of the points")
    own.set_defaults(run=run_make_large, out=None)
    own = commands.add_parser("found", help="which changes of such a pair `gmmjax detect` reported")
    own.add_argument("changes", type=Path, metavar="CHANGES.CSV", help="of its result")
    own.add_argument("--kind", choices=list(KINDS), default="hall")
    own.add_argument("--seed", type=int, default=0)
    own.add_argument("--copies", type=int, default=1, help="of the scene, as the pair was made")
    own.add_argument("--points", type=int, default=400_000, help="a side of the scene that has the truth")
    own.set_defaults(run=run_found, out=None)
    own = commands.add_parser("scaling", help="time and memory of `gmmjax detect` by the number of points")
    own.add_argument("--sizes", nargs="*", type=int, default=[], metavar="POINTS", help="points a side")
    own.add_argument("--kind", choices=list(KINDS), default="hall")
    own.add_argument("--folder", type=Path, default=Path("."), help="for files and results")
    own.add_argument("--log", type=Path, required=True, help="CSV that a line is added to for each run")
    own.add_argument("--options", default="", help="of `gmmjax detect`, in one word: '--options=--workers 2'")
    own.add_argument("--figure", type=Path, help="PNG, drawn from the log")
    own.add_argument("--wall", action="store_true", help="the figure has the time on the clock, too")
    own.add_argument("--out", type=Path, help="file that the table is written to")
    own.set_defaults(run=run_scaling)
    return result


def run_accuracy(arguments: argparse.Namespace) -> None:
    views = get_args(Views) if arguments.views == "both" else (arguments.views,)
    ours, peers = arguments.peers != "only", arguments.peers != "without"
    asked = arguments.seeds, arguments.points, views, ours, peers, arguments.verdict
    jobs = [Job(kind, *asked) for kind in arguments.kinds]
    text = f"{conditions()}\n\n" + to_markdown(line for job in jobs for line in accuracy(job))
    print(text)
    if arguments.out:
        arguments.out.write_text(text)


def run_write(arguments: argparse.Namespace) -> None:
    arguments.out.mkdir(exist_ok=True)
    for kind in arguments.kinds:
        for seed in arguments.seeds:
            pair = simulated(kind, seed, arguments.points, changed=not arguments.unchanged)
            write_scene(arguments.out / f"{kind}_{seed}{'_unchanged' * arguments.unchanged}", pair)


def run_make_large(arguments: argparse.Namespace) -> None:
    counts = write_large(Pair(*arguments.paths), arguments.points, arguments.kind, arguments.seed, arguments.copies)
    for path, count in zip(arguments.paths, counts, strict=True):
        print(f"{path}: {count:,} points")


def run_found(arguments: argparse.Namespace) -> None:
    made, random = kind_of(arguments.kind), drawn_from(arguments.kind, arguments.seed)
    site = made.site(random, True)
    pair = surveyed(arguments.kind, site, arguments.points, made.errors, np.array(GRID), random)
    print(found_in_large(arguments.changes, pair, copies_of(site, arguments.copies)))


def run_scaling(arguments: argparse.Namespace) -> None:
    from tests.benchmarks.surveyor import scaling

    options = shlex.split(arguments.options)
    scaling.scaling(arguments.sizes, arguments.folder, arguments.log, options, arguments.kind)
    if arguments.figure:
        scaling.draw(arguments.log, arguments.figure, wall=arguments.wall)
    text = f"{conditions()}\n\n{scaling.table(arguments.log)}"
    print(text)
    if arguments.out:
        arguments.out.write_text(text)


def _scenes(own: argparse.ArgumentParser) -> None:
    every = [*KINDS, *HELD_OUT]
    own.add_argument("--kinds", nargs="+", choices=every, default=list(KINDS), metavar="KIND", help=", ".join(every))
    own.add_argument("--seeds", nargs="+", type=int, default=[0], metavar="SEED")
    own.add_argument("--points", type=int, default=400_000, help="about so many a side")


if __name__ == "__main__":
    main()
