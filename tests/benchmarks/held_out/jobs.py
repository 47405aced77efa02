"""The work of the command, kind by kind, in one process or in several."""

import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

from gmmjax.evaluation import ReliabilityRecord, detector, evaluate
from tests.benchmarks.held_out.kinds import Poses, held_out_sources
from tests.benchmarks.held_out.peers import best_peers
from tests.benchmarks.held_out.records import Records
from tests.benchmarks.held_out.table import Line, lines_of


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


def results(jobs: Sequence[Job], workers: int) -> Iterator[Done]:
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
    lines, failures = lines_of(evaluation, records.motions), [str(failure) for failure in evaluation.failures]
    if job.peers_best:
        lines, failures = (own + more for own, more in zip((lines, failures), best_peers(sources), strict=True))
    for line in lines:
        print(" | ".join(line.cells()), file=sys.stderr, flush=True)
    return Done(lines, records.reliability, failures)
