"""A program for any version of gmmjax: `python -P detect_there.py FILE REPEATS`, with its root as `PYTHONPATH`.

It detects in the two clouds of a file, once and then so many times, and prints a line of JSON. Of gmmjax it uses only
what every version has had.
"""

import json
import statistics
import sys
import time
import warnings
from pathlib import Path

import jax
import numpy as np

import gmmjax


def memory(name):
    """A line of this process's memory, bytes."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))


class Stages:
    """The CPU seconds of each stage, by what the progress says of it."""

    def __init__(self):
        self.seconds, self.stage, self.began = {}, None, 0.0

    def __call__(self, stage, share):
        now = time.process_time()
        if self.stage is not None:
            self.seconds[self.stage] = self.seconds.get(self.stage, 0.0) + now - self.began
        self.stage, self.began = stage, now


def main():
    warnings.simplefilter("ignore")
    arrays = np.load(sys.argv[1])
    held, walls, cpus = memory("VmRSS"), [], []
    for _ in range(1 + int(sys.argv[2])):
        stages, wall, cpu = Stages(), time.perf_counter(), time.process_time()
        changes = gmmjax.detect_changes(arrays["before"], arrays["after"], progress=stages)
        jax.block_until_ready(changes.probability_after)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    found = {"cpu": statistics.median(cpus[1:]), "wall": statistics.median(walls[1:]), "changes": len(changes.items)}
    found["stages"] = stages.seconds
    print(json.dumps({"package": gmmjax.__file__, **found, "memory": (memory("VmHWM") - held) / 1e9}))


if __name__ == "__main__":
    main()
