"""Batch runs: how fast, how much memory, and how many pairs a driver can serve.

`python -m tests.benchmarks.batch_runs pairs DIR` writes simulated pairs and their manifests;
`... compare DIR/rooms/manifest.csv --log compare.jsonl` times `gmmjax batch` beside a loop over `gmmjax detect`;
`... memory DIR/changing/manifest.csv --log memory.csv` draws the memory of the workers;
`... ceiling --log ceiling.jsonl` measures the driver with empty work.

Each prints Markdown, or writes it to its place in a page, `--page docs/benchmarks.md`. A command that was stopped goes
on where it was: what is in its log is not measured again.
"""

import argparse
import os
from pathlib import Path

from tests.benchmarks import batch_ceiling, batch_compare, batch_memory, batch_pairs
from tests.benchmarks.page import put


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)

    pairs = commands.add_parser("pairs", help="write pairs and manifests")
    pairs.add_argument("folder", type=Path, help="has a folder for each kind in the end")
    pairs.add_argument("--kinds", nargs="+", choices=batch_pairs.KINDS, default=["gaussians", "rooms"])
    pairs.add_argument("--count", type=int, default=200, help="of each kind")
    pairs.set_defaults(run=write_pairs)

    compare = commands.add_parser("compare", help="batch runs beside a loop")
    compare.add_argument("manifests", type=Path, nargs="+")
    compare.add_argument("--log", type=Path, required=True, help="JSON lines")
    compare.add_argument("--scratch", type=Path, required=True, help="for results, which are removed")
    compare.add_argument("--chunk", type=int, default=40, help="pairs in a turn")
    compare.add_argument("--turns", type=int, default=5)
    compare.add_argument("--restarts", type=int, default=16)
    compare.add_argument("--contenders", nargs="+", choices=batch_compare.CONTENDERS, default=batch_compare.CONTENDERS)
    compare.set_defaults(run=run_comparison)

    memory = commands.add_parser("memory", help="resident memory of the workers of one run")
    memory.add_argument("manifest", type=Path)
    memory.add_argument("--log", type=Path, required=True, help="CSV, a line for each process and sample")
    memory.add_argument("--out", type=Path, required=True, help="folder of the run")
    memory.add_argument("--figure", type=Path, help="SVG, drawn from the log")
    memory.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    memory.add_argument("--restarts", type=int, default=2)
    memory.add_argument("--every", type=float, default=1.0, help="seconds between two samples")
    memory.add_argument("--draw-only", action="store_true", help="draw the log of an earlier run")
    memory.set_defaults(run=run_memory)

    ceiling = commands.add_parser("ceiling", help="pairs a second with empty work")
    ceiling.add_argument("--log", type=Path, required=True, help="JSON lines")
    ceiling.add_argument("--pairs", type=int, default=20_000)
    ceiling.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4], help="processes of this machine")
    ceiling.add_argument("--threads", type=int, nargs="+", default=[2, 16, 128], help="of two Dask workers together")
    ceiling.add_argument(
        "--out", type=int, nargs="+", default=[2, 128, 2048, 16384], help="messages of the driver alone"
    )
    ceiling.add_argument("--repeats", type=int, default=5)
    ceiling.add_argument("--pools", nargs="+", choices=batch_ceiling.POOLS, default=[*batch_ceiling.POOLS])
    ceiling.set_defaults(run=run_ceiling)

    for command in (compare, memory, ceiling):
        command.add_argument("--page", type=Path, help="Markdown file with a place for the tables")
    arguments = parser.parse_args()
    arguments.run(arguments)


def write_pairs(arguments: argparse.Namespace) -> None:
    for kind in arguments.kinds:
        print(batch_pairs.write_pairs(arguments.folder / kind, kind, arguments.count))


def run_comparison(arguments: argparse.Namespace) -> None:
    for manifest in arguments.manifests:
        batch_compare.measure(
            manifest,
            arguments.log,
            arguments.scratch,
            chunk=arguments.chunk,
            turns=arguments.turns,
            restarts=arguments.restarts,
            contenders=arguments.contenders,
        )
    lines = batch_compare.read(arguments.log)
    put(arguments.page, "batch comparison", f"{batch_compare.verdicts(lines)}\n\n{batch_compare.table(lines)}")


def run_memory(arguments: argparse.Namespace) -> None:
    if not arguments.draw_only:
        words = ["--workers", str(arguments.workers), "--restarts", str(arguments.restarts)]
        batch_memory.run(arguments.manifest, arguments.out, arguments.log, words, arguments.every)
    text = batch_memory.summary(arguments.log)
    if arguments.figure:
        batch_memory.draw(arguments.log, arguments.figure)
        beside = os.path.relpath(arguments.figure, arguments.page.parent) if arguments.page else arguments.figure
        text += f"\n\n![Resident memory of the driver and the workers of a batch run]({beside})"
    put(arguments.page, "batch memory", text)


def run_ceiling(arguments: argparse.Namespace) -> None:
    sizes = {"driver alone": arguments.out, "processes": arguments.workers, "dask": arguments.threads}
    sizes = {pool: sizes[pool] for pool in arguments.pools}
    batch_ceiling.measure(arguments.log, sizes, arguments.pairs, arguments.repeats)
    put(arguments.page, "batch ceiling", f"{batch_ceiling.table(arguments.log)}\n\n{batch_ceiling.table_of_bytes()}")


if __name__ == "__main__":
    main()
