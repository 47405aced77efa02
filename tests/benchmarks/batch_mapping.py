"""How to compute many small pairs that are alike: one vmap, or a queue of restarts or pairs over threads or processes?

`python -m tests.benchmarks.batch_mapping --log mapping.jsonl` prints a Markdown table.

Fits, posteriors, exact transport, and whole detections of pairs of artificial scenes, all of one shape, are timed in
turns, in processes that see one core and all of them. `plain` is XLA's own code in place of the compiled kernels. A
line of the log is written for each case, so that a run that was stopped goes on where it was: what is in the log is not
measured again.
"""

import argparse
import contextlib
import itertools
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from tests.benchmarks import mapped_work
from tests.benchmarks.conftest import seconds
from tests.benchmarks.interleaved import Elsewhere, Interleaved, Timing, load
from tests.benchmarks.page import put
from tests.benchmarks.workers import worker

COLUMNS = (
    *("what", "points a cloud", "pairs x restarts", "cores", "mapping", "wall", "CPU", "compilation"),
    *("wall / pair after pair", "largest difference", "turns", "load"),
)
# What the others are compared with: a loop over pairs, of which each has its restarts on all cores.
REFERENCE = "pair after pair"
CALLS: dict[str, Callable[..., Any]] = {
    REFERENCE: mapped_work.pair_after_pair,
    "pair after pair, the library's chunks": mapped_work.pair_after_pair_in_chunks,
    "queue of restarts": mapped_work.queue_of_restarts,
    "queue of pairs": mapped_work.queue_of_pairs,
    "queue of pairs, vmap of restarts": mapped_work.queue_of_vmaps,
    "one vmap": mapped_work.one_vmap,
    "one vmap, plain": mapped_work.one_plain_vmap,
}
PROCESSES = "queue of processes"
MAPPINGS = (*CALLS, PROCESSES)
OPERATIONS = (*mapped_work.OPERATIONS, "detection")


# Points of all clouds up to which XLA's own code is measured, which takes ten times as long: an hour for a few more.
PLAIN_UP_TO = 100_000


class Case(NamedTuple):
    """What is measured in one table's block."""

    operation: str
    points: int
    pairs: int
    restarts: int
    cores: int


def applies(mapping: str, case: Case) -> bool:
    """Whether there is such a mapping of the operation, and it ends in time."""
    if case.operation == "detection":
        return mapping in (REFERENCE, "queue of pairs", PROCESSES)
    if mapping == "one vmap, plain" and 2 * case.points * case.pairs > PLAIN_UP_TO:
        return False
    # Only fits have a program for one restart, and only posteriors are computed in chunks.
    own = {"queue of restarts": "fits", "pair after pair, the library's chunks": "posteriors"}
    return own.get(mapping, case.operation) == case.operation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--log", type=Path, required=True, help="JSON lines, one for each case that is measured")
    parser.add_argument("--operations", nargs="+", choices=OPERATIONS, default=[*OPERATIONS])
    sizes = [(16, 500), (64, 500), (16, 5000)]
    parser.add_argument(
        "--sizes", type=size, nargs="+", default=sizes, help="pairs x points of a cloud, such as 16x500"
    )
    parser.add_argument("--restarts", type=int, default=8)
    parser.add_argument("--cores", type=int, nargs="+", default=sorted({1, len(os.sched_getaffinity(0))}))
    parser.add_argument("--mappings", nargs="+", choices=MAPPINGS, default=[*MAPPINGS])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--page", type=Path, help="Markdown file with a place for the table")
    arguments = parser.parse_args()
    measured = {Case(*line["case"]) for line in read(arguments.log)}
    for pairs, points in arguments.sizes:
        cases = [
            Case(operation, points, pairs, arguments.restarts, cores)
            for operation, cores in itertools.product(arguments.operations, arguments.cores)
        ]
        if left := [case for case in cases if case not in measured]:
            measure_all(left, arguments.mappings, arguments.repeats, arguments.log)
    put(arguments.page, "batch mapping", table(read(arguments.log)))


def size(text: str) -> tuple[int, int]:
    """Pairs and points of 16x500."""
    pairs, points = text.split("x")
    return int(pairs), int(points)


def read(log: Path) -> list[dict[str, Any]]:
    """What was measured already."""
    return [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []


def measure_all(cases: list[Case], mappings: list[str], repeats: int, log: Path) -> None:
    """The cases of one size, on the same pairs and the same fits."""
    _, points, pairs, restarts, _ = cases[0]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pairs.npz"
        problems = mapped_work.problems_of_scenes(points, pairs, restarts)
        mapped_work.save(path, problems, None)
        slots = int(problems.components.max())
        mapped_work.save(path, problems, mapped_work.queue_of_restarts("fits", path, slots))
        mapped_work.loaded.cache_clear()
        for case in cases:
            before = load()
            timings = measure(case, path, slots, mappings, repeats)
            line = {"case": case, "load": [before, load()], "mappings": as_numbers(case, timings)}
            with log.open("a") as file:
                file.write(json.dumps(line) + "\n")


def measure(case: Case, path: Path, slots: int, mappings: list[str], repeats: int) -> dict[str, Timing]:
    """The mappings of a case in turns; the first turn compiles and is not counted."""
    with contextlib.ExitStack() as stack:
        contenders = {
            mapping: stack.enter_context(contender(mapping, case, path, slots))
            for mapping in mappings
            if applies(mapping, case)
        }
        turns = Interleaved(contenders)
        for _ in range(repeats + 1):
            turns.turn()
    return turns.timings


@contextlib.contextmanager
def contender(mapping: str, case: Case, path: Path, slots: int) -> Iterator[Callable[[], Elsewhere]]:
    """A mapping in processes of its own, which see so many cores."""
    if mapping == PROCESSES:
        with mapped_work.ProcessQueue(sorted(os.sched_getaffinity(0))[: case.cores]) as queue:
            yield lambda: queue.run(case.operation, path, slots, case.pairs)
        return
    with worker(case.cores) as call:
        yield lambda: call(CALLS[mapping], case.operation, path, slots)


def as_numbers(case: Case, timings: dict[str, Timing]) -> dict[str, Any]:
    """Seconds, and how the answer differs from the reference's."""
    reference = timings[REFERENCE].answer
    return {
        mapping: {**timing.summary(), "difference": difference(reference, timing.answer)}
        for mapping, timing in timings.items()
    }


def difference(reference: Any, answer: Any) -> float | None:
    """Of message lengths, nats; of posteriors; of distances, in the frame of the fits. None: all bits are the same."""
    leaves = zip(jax.tree.leaves(reference), jax.tree.leaves(answer), strict=True)
    if all(np.array_equal(own, other) for own, other in leaves):
        return None
    both = (
        [answer.message_length] if isinstance(answer, mapped_work.Fitted) else answer for answer in (reference, answer)
    )
    return max(float(np.abs(own - other).max()) for own, other in zip(*map(jax.tree.leaves, both), strict=True))


def table(lines: list[dict[str, Any]]) -> str:
    """A row for each mapping of each case."""
    rows = ["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
    for line in lines:
        case = Case(*line["case"])
        reference = line["mappings"][REFERENCE]["wall_s"]
        for mapping, times in line["mappings"].items():
            cells = [
                *(case.operation, f"{case.points:,}", f"{case.pairs} x {case.restarts}", str(case.cores), mapping),
                *(seconds(times[part]) for part in ("wall_s", "cpu_s", "compilation_s")),
                *(f"{times['wall_s'] / reference:.2f}", agreement(times["difference"])),
                *(str(len(times["walls_s"])), f"{max(line['load']):.1f}"),
            ]
            rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def agreement(difference: float | None) -> str:
    """See `difference`."""
    return "same bits" if difference is None else f"{difference:.1g}"


if __name__ == "__main__":
    main()
