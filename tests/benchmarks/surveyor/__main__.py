"""What surveyors ask of a comparison of two scans, measured: `python -m tests.benchmarks.surveyor COMMAND`."""

import argparse
from pathlib import Path
from typing import get_args

from tests.benchmarks.page import conditions
from tests.benchmarks.surveyor.accuracy import Job, Views, accuracy, to_markdown
from tests.benchmarks.surveyor.files import write_scene
from tests.benchmarks.surveyor.kinds import HELD_OUT, KINDS, simulated


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
    own.add_argument("--out", type=Path, help="file that the table is written to")
    own.set_defaults(run=run_accuracy)
    own = commands.add_parser("write", help="a folder of scenes, one .npz each")
    _scenes(own)
    own.add_argument("--unchanged", action="store_true", help="the twins in which nothing changed")
    own.add_argument("--out", type=Path, required=True, help="folder")
    own.set_defaults(run=run_write)
    return result


def run_accuracy(arguments: argparse.Namespace) -> None:
    views = get_args(Views) if arguments.views == "both" else (arguments.views,)
    ours, peers = arguments.peers != "only", arguments.peers != "without"
    jobs = [Job(kind, arguments.seeds, arguments.points, views, ours, peers) for kind in arguments.kinds]
    text = f"{conditions()}\n\n" + to_markdown(line for job in jobs for line in accuracy(job))
    print(text)
    if arguments.out:
        arguments.out.write_text(text)


def run_write(arguments: argparse.Namespace) -> None:
    arguments.out.mkdir(exist_ok=True)
    for kind in arguments.kinds:
        for seed in arguments.seeds:
            pair = simulated(kind, seed, arguments.points, changed=not arguments.unchanged)
            write_scene(arguments.out / f"{kind}_{seed}{'_unchanged' * arguments.unchanged}.npz", pair)


def _scenes(own: argparse.ArgumentParser) -> None:
    every = [*KINDS, *HELD_OUT]
    own.add_argument("--kinds", nargs="+", choices=every, default=list(KINDS), metavar="KIND", help=", ".join(every))
    own.add_argument("--seeds", nargs="+", type=int, default=[0], metavar="SEED")
    own.add_argument("--points", type=int, default=400_000, help="about so many a side")


if __name__ == "__main__":
    main()
