"""How many pairs a second the driver of a batch run can serve: its workers return a record at once.

A record has the size of that of a real pair. Measured are the driver alone, without any message, by the number of
chunks that are out at a time; the driver with processes of this machine; and with a Dask cluster of this machine. Each
with chunks of 64 pairs, as short pairs get them, and with one pair a message, as pairs of some seconds do.
"""

import collections
import contextlib
import dataclasses
import functools
import itertools
import json
import logging
import pickle
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np

from gmmjax.batch.driver import results_of
from gmmjax.batch.fingerprint import Fingerprint
from gmmjax.batch.pair_record import PairRecord
from gmmjax.batch.pools import AbstractPool, ClusterPool, LocalPool
from gmmjax.batch.rows import ChangeRow, ConvergenceRow, PairRow
from gmmjax.batch.scan_pair import BatchPair
from gmmjax.batch.worker import PairResult, PairTask
from gmmjax.changes import DetectionConfig
from gmmjax.clouds import PointCloud
from tests.benchmarks.interleaved import load

CHUNKS = {"64 pairs a message": 64, "1 pair a message": 1}
CHANGES = 5
# What `gmmjax batch` writes for a pair.
FILES = (
    *("changes.json", "labels.npz", "before.ply", "after.ply", "report.html", "config.toml", "fits.npz"),
    *("before.png", "after.png"),
)
STAGES = ("reading", "preparation", "registration", "fits", "changes", "moved", "detection", "writing")


class FullPool(AbstractPool):
    """Always as full as it may be: with every call that is handed over the oldest one is done, and no other."""

    def __init__(self, capacity: int):
        self.capacity = capacity
        self._out: collections.deque[tuple[Future[Any], Any, tuple[Any, ...]]] = collections.deque()

    def submit(self, function: Any, *arguments: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        self._out.append((future, function, arguments))
        if len(self._out) >= self.capacity:
            oldest, function, arguments = self._out.popleft()
            oldest.set_result(function(*arguments))
        return future

    def stop(self, *, at_once: bool) -> None:
        self._out.clear()


@contextlib.contextmanager
def driver_alone(capacity: int) -> Iterator[AbstractPool]:
    yield FullPool(capacity)


@contextlib.contextmanager
def processes(workers: int) -> Iterator[AbstractPool]:
    yield LocalPool(workers, 1)


@contextlib.contextmanager
def dask(threads: int) -> Iterator[AbstractPool]:
    """A cluster of this machine: a process for the scheduler and two for workers, with so many threads in all."""
    ours, theirs = get_context("spawn").Pipe()
    process = get_context("spawn").Process(target=_cluster, args=(threads, theirs))
    process.start()
    # When the driver has what it wants, what the cluster is still computing is of no interest.
    logging.disable()
    try:
        yield ClusterPool(ours.recv())
    finally:
        ours.send("end")
        process.join()
        logging.disable(logging.NOTSET)


def _cluster(threads: int, driver: Connection) -> None:
    from distributed import LocalCluster

    logging.disable()
    with LocalCluster(n_workers=2, threads_per_worker=threads // 2, dashboard_address=None, silence_logs=50) as cluster:
        driver.send(cluster.scheduler_address)
        driver.recv()


POOLS: dict[str, Callable[[int], contextlib.AbstractContextManager[AbstractPool]]] = {
    "driver alone": driver_alone,
    "processes": processes,
    "dask": dask,
}


def task(number: int) -> PairTask:
    """A pair of a manifest, with its files, for a folder of results."""
    name = f"station-{number:05}"
    scans = "/data/surveys/2026-11-22/building-4/floor-2"
    pair = BatchPair(name, Path(f"{scans}/{name}/before.ply"), Path(f"{scans}/{name}/after.ply"))
    return PairTask(pair, DetectionConfig(restarts=16), folder=Path(f"/data/results/2026-11-22/pairs/{name}"))


def empty_work(tasks: Sequence[PairTask]) -> list[PairResult]:
    """A record for each pair, of a realistic size, without computing anything."""
    return [PairResult(task.pair.name, record(task)) for task in tasks]


def no_work(tasks: Sequence[PairTask]) -> list[PairResult]:
    """The same record for every pair, for the driver alone."""
    return [PairResult(task.pair.name, _known_record()) for task in tasks]


@functools.cache
def _known_record() -> PairRecord:
    return record(task(0))


def record(task: PairTask) -> PairRecord:
    """As a pair with five changes has it."""
    fingerprint = Fingerprint(1_234_567, 1_790_000_000_123_456_789, "0123456789abcdef" * 4)
    files = task.pair.files()
    changes = tuple(_filled(ChangeRow, name=task.pair.name, kind="appeared", change=own) for own in range(CHANGES))
    clouds = {role: str(file) for role, file in files.items()}
    # A pair of hardly any time, so that chunks get as large as they may.
    texts = {"name": task.pair.name, "status": "done", "error": "", "warnings": ""}
    pair = _filled(PairRow, **clouds, **texts, seconds=1e-6)
    return PairRecord(
        request=task.request,
        inputs=dict.fromkeys(files, fingerprint),
        files=dict.fromkeys(FILES, fingerprint),
        pair=pair,
        changes=changes,
        convergence=tuple(_filled(ConvergenceRow, name=task.pair.name, restarts=2**own) for own in range(1, 5)),
        seconds=dict.fromkeys(STAGES, 0.1234),
        finished=1_790_000_000.123,
    )


def _filled(record: Any, **known: Any) -> Any:
    """A row with some value of the right type in every field."""
    return record(**{**_values(record), **known})


@functools.cache
def _values(record: Any) -> dict[str, Any]:
    values = {int: 12_345, float: 0.123456789, bool: True, str: "text"}
    kinds = {name: (hint, *get_args(hint)) for name, hint in get_type_hints(record).items()}
    return {name: next((values[kind] for kind in values if kind in of), None) for name, of in kinds.items()}


def measure(log: Path, sizes: dict[str, Sequence[int]], pairs: int, repeats: int) -> None:
    """Adds what is not in the log yet: the seconds of each repeat.

    Args:
        log: JSON lines.
        sizes: for each of `POOLS` that takes part the numbers of workers, or of chunks that are out at a time.
        pairs: of a repeat, where 64 go into a message; with one a message there are an eighth of them.
        repeats: of each.
    """
    done = {(line["pool"], line["size"], line["chunk"]) for line in read(log)}
    for pool, of_pool in sizes.items():
        for size in of_pool:
            for chunk in CHUNKS:
                if (pool, size, chunk) not in done:
                    count = pairs if CHUNKS[chunk] > 1 else pairs // 8
                    line = {"pool": pool, "size": size, "chunk": chunk, **timed(pool, size, chunk, count, repeats)}
                    with log.open("a") as file:
                        file.write(json.dumps(line) + "\n")


def read(log: Path) -> list[dict[str, Any]]:
    """What was measured already."""
    return [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []


def timed(pool: str, size: int, chunk: str, pairs: int, repeats: int) -> dict[str, Any]:
    """Pairs a second when every worker has started and all messages are out; CPU seconds of this process a pair."""
    work = no_work if pool == "driver alone" else empty_work
    rates, cpus, sent, before = [], [], [], load()
    for _ in range(repeats):
        with POOLS[pool](size) as opened:
            # Without end, so that the pool is full all the time.
            results = results_of(map(task, itertools.count()), opened, work, largest_chunk=CHUNKS[chunk])
            # Until every worker has answered, and what is out has grown from one pair to whole chunks.
            skipped = opened.capacity + 10 * CHUNKS[chunk]
            collections.deque(itertools.islice(results, skipped), maxlen=0)
            wall, cpu, network = time.perf_counter(), time.process_time(), loopback_bytes()
            collections.deque(itertools.islice(results, pairs), maxlen=0)
            rates.append(pairs / (time.perf_counter() - wall))
            cpus.append((time.process_time() - cpu) / pairs)
            sent.append((loopback_bytes() - network) / pairs)
            results.close()
    return {"pairs": pairs, "rates": rates, "cpus": cpus, "sent": sent, "load": [before, load()]}


def loopback_bytes() -> int:
    """That this machine has sent to itself, of all processes: what a cluster of this machine sends."""
    lines = Path("/proc/net/dev").read_text().splitlines()
    return next((int(line.split()[1]) for line in lines if line.strip().startswith("lo:")), 0)


def table(log: Path) -> str:
    """A row for each pool, size and chunk: medians."""
    what = "workers (driver alone: messages out)"
    columns = ("pool", what, "message", "pairs a second", "CPU of the driver a pair", "network a pair", "load")
    rows = ["| " + " | ".join(columns) + " |", "|---" * len(columns) + "|"]
    for line in read(log):
        rate, cpu = statistics.median(line["rates"]), statistics.median(line["cpus"])
        network = f"{statistics.median(line['sent']):,.0f} bytes" if line["pool"] == "dask" else ""
        cells = [line["pool"], f"{line['size']:,}", line["chunk"], f"{rate:,.0f}", f"{1e6 * cpu:,.0f} µs", network]
        rows.append("| " + " | ".join([*cells, f"{max(line['load']):.1f}"]) + " |")
    return "\n".join(rows)


def table_of_bytes() -> str:
    """What a pair costs in messages: each way, for workers that see the files, and for those that do not."""
    rows = ["| what the driver sends and receives | bytes a pair |", "|---|---|"]
    for size in CHUNKS.values():
        tasks = [task(number) for number in range(size)]
        to, back = pickled((empty_work, tasks)) / size, pickled(empty_work(tasks)) / size
        rows.append(f"| task, {size} in a message | {to:,.0f} |")
        rows.append(f"| record, {size} in a message | {back:,.0f} |")
    cloud = PointCloud.from_rows(np.random.default_rng(0).normal(size=(50_000, 3)))
    whole = dataclasses.replace(task(0), pair=BatchPair("station-00000", cloud, cloud), folder=None)
    rows.append(f"| task with its clouds, 2 x 50,000 points | {pickled((empty_work, [whole])):,.0f} |")
    return "\n".join(rows)


def pickled(content: Any) -> int:
    """Bytes by the standard library; Dask's serialiser uses it for what it has no way of its own for."""
    return len(pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL))
