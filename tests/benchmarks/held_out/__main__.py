"""How detectors do on scenes that nothing was trained on: `python -m tests.benchmarks.held_out --seeds 2`.

For each kind of scene, with the sensors' poses and without, a line of figures for each detector; below, how far the
probabilities of all of them can be believed. With `--peers-best` each peer is given the setting, of a coarse series,
that is the best for that very kind.
"""

import argparse
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple, get_args

from gmmjax.errors import InputError
from gmmjax.evaluation import NAMES, ReliabilityRecord, detector, evaluate
from tests.benchmarks.held_out.kinds import KINDS, Poses, held_out_sources
from tests.benchmarks.held_out.peers import best_peers
from tests.benchmarks.held_out.records import Records, pooled
from tests.benchmarks.held_out.table import Line, lines_of, to_markdown


class Job(NamedTuple):
    """The scenes of one kind, with poses or without, and what is asked of them."""

    kind: str
    poses: Poses
    seeds: range
    methods: tuple[str, ...]
    peers_best: bool


class Done(NamedTuple):
    """The figures of a job, how far its probabilities can be believed, and what failed."""

    lines: list[Line]
    reliability: ReliabilityRecord
    failures: list[str]


def main() -> None:
    arguments = parser().parse_args()
    try:
        jobs = jobs_of(arguments)
        done = list(results(jobs, arguments.workers))
    except InputError as error:
        sys.exit(str(error))
    text = to_markdown([line for job in done for line in job.lines])
    reliability = pooled([(f"poses {job.poses}", own.reliability) for job, own in zip(jobs, done, strict=True)])
    text += "\n" + reliability.to_markdown() if reliability.changes else ""
    failures = dict.fromkeys(failure for job in done for failure in job.failures)
    text += "".join(f"\n- failed: {failure}" for failure in failures)
    print(text)
    if arguments.out:
        arguments.out.write_text(text)


def parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument(
        "--kinds", nargs="+", choices=tuple(KINDS), default=list(KINDS), metavar="KIND", help=", ".join(KINDS)
    )
    result.add_argument(
        "--seeds", type=int, default=2, help="scenes of each kind that changed, and as many that did not"
    )
    result.add_argument("--first-seed", type=int, default=0, help="seeds count from here")
    result.add_argument("--poses", choices=("given", "unknown", "both"), default="both")
    result.add_argument(
        "--methods", nargs="*", choices=NAMES, default=["joint"], metavar="METHOD", help=", ".join(NAMES)
    )
    result.add_argument("--peers-best", action="store_true", help="each peer at its best setting for the kind")
    result.add_argument("--workers", type=int, default=1, help="processes")
    result.add_argument("--out", type=Path, help="file that the table is written to")
    return result


def jobs_of(arguments: argparse.Namespace) -> list[Job]:
    """A job for each kind, with poses and without."""
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    known = get_args(Poses) if arguments.poses == "both" else (arguments.poses,)
    return [
        Job(kind, poses, seeds, tuple(arguments.methods), arguments.peers_best)
        for kind in arguments.kinds
        for poses in sorted(known, reverse=True)
    ]


def results(jobs: list[Job], workers: int) -> Iterator[Done]:
    """The results of the jobs, in their order."""
    if workers == 1:
        yield from map(result, jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(result, jobs)


def result(job: Job) -> Done:
    """Runs a job."""
    sources = held_out_sources([job.kind], job.seeds, [job.poses])
    records = Records()
    evaluation = evaluate({name: detector(name) for name in job.methods}, sources, record=records.add)
    lines = lines_of(evaluation, records.motions) + (best_peers(sources) if job.peers_best else [])
    for line in lines:
        print(" | ".join(line.cells()), file=sys.stderr, flush=True)
    return Done(lines, records.reliability, [str(failure) for failure in evaluation.failures])


if __name__ == "__main__":
    main()
