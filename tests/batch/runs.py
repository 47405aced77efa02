"""Small runs for the tests: a manifest of Gaussian scenes on disk, and what a run left."""

import atexit
import contextlib
import csv
import functools
import io
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from unittest import mock

import numpy as np

from gmmjax.batch.pools import ExecutorPool, Workers
from gmmjax.cli import main
from gmmjax.clouds import write_ply

ROOT = Path(__file__).parents[2]
MEANS = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 1], [5, 5, 1], [2, 10, 3]], float)
# One padded size, and few components: one small program for all.
SETTINGS = {"restarts": 2, "max_components": 8, "registration": "never"}
FLAGS = ["--restarts", "2", "--max-components", "8", "--registration", "never"]
# A job in the background passes on that it ignores Ctrl-C. (`preexec_fn` would fork a process with JAX's threads.)
HEAR_CTRL_C = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.SIG_DFL)
os.execv(sys.argv[1], sys.argv[1:])
"""


def cloud(seed, gaussians=5, points=60):
    random = np.random.default_rng(seed)
    return random.normal(size=(gaussians * points, 3)) * 0.3 + np.repeat(MEANS[:gaussians], points, axis=0)


def write_manifest(folder, count=5, name="manifest.csv"):
    """Pairs in which a Gaussian appeared, or disappeared."""
    rows = []
    for number in range(count):
        sides = [cloud(10 * number, 4 + number % 2), cloud(10 * number + 1, 5 - number % 2)]
        files = [f"{side}{number}.ply" for side in ("before", "after")]
        for file, points in zip(files, sides, strict=True):
            write_ply(folder / file, points)
        rows.append([f"pair {number}", *files])
    path = folder / name
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([["name", "before", "after"], *rows])
    return path


def command(*words):
    return [sys.executable, "-m", "gmmjax", "batch", *map(str, words)]


def environment():
    paths = [str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in paths if path)}


def run(*words):
    """What the command does, in this process, with the shared worker."""
    output, errors = io.StringIO(), io.StringIO()
    in_worker = mock.patch.object(Workers, "pool", lambda *_: ExecutorPool(worker(), 2))
    with in_worker, contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        status = main(["batch", *map(str, words)])
    return subprocess.CompletedProcess(words, status, output.getvalue(), errors.getvalue())


def start(*words):
    program, *arguments = command(*words)
    return subprocess.Popen(
        [program, "-c", HEAR_CTRL_C, program, *arguments],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@functools.cache
def worker():
    """One process for many runs: starting one takes longer than what it has to do."""
    executor = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
    atexit.register(executor.shutdown)
    return executor


def workers_of(process):
    """The processes that compute for a run: they are started by `spawn`."""
    children = []
    # A thread or a process may end while it is looked at.
    for task in Path("/proc").glob(f"{process}/task/*"):
        with contextlib.suppress(OSError):
            children += map(int, (task / "children").read_text().split())
    return [child for child in children if b"spawn_main" in _read(f"/proc/{child}/cmdline")]


def wait_for(condition, seconds=300.0):
    """Until it is true."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "it did not become true"
        time.sleep(0.01)
    return found


def is_alive(process):
    # After the name, which may hold anything, comes the state.
    state = _read(f"/proc/{process}/stat").rpartition(b")")[2].split()[:1]
    return state not in ([], [b"Z"])


def _read(path):
    """What a file of a process holds; nothing where the process is gone."""
    try:
        return Path(path).read_bytes()
    except OSError:
        return b""


def kill(process):
    os.kill(process, signal.SIGKILL)


def done_pairs(folder):
    return sorted(path.parent.name for path in folder.glob("pairs/[!.]*/pair.json"))


def contents(folder):
    """All that a run found, byte by byte; when and how fast it did is in `pair.json`."""
    files = [path for path in sorted(folder.glob("pairs/[!.]*/*")) if path.is_file() and path.name != "pair.json"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
