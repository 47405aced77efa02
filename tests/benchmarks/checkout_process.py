"""Detections by one checkout, in a process that stays: started by `checkouts`, with that checkout on the path.

It imports nothing of the tests, so that the package may be of any age: only `detect_changes` and `SensorViews`. A line
on the standard input is the path of a pair's arrays; a line of JSON on the standard output is what one detection of it
took and found.
"""

import hashlib
import inspect
import json
import sys
import time
import warnings

import numpy as np

import gmmjax
from gmmjax import SensorViews, detect_changes


def main() -> None:
    warnings.simplefilter("ignore")
    print(json.dumps(inspect.getfile(gmmjax)), flush=True)
    for line in sys.stdin:
        print(json.dumps(timed_detection(line.rstrip("\n"))), flush=True)


def timed_detection(path: str) -> dict:
    """CPU and wall seconds of a detection, the number of changes of each kind, and a digest of all that was found."""
    with np.load(path) as arrays:
        pair, views = arrays_of(arrays)
    wall, cpu = time.perf_counter(), time.process_time()
    found = detect_changes(*pair, **views)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    kinds = [change.kind for change in found.items]
    return {
        "wall": wall,
        "cpu": cpu,
        "kinds": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "digest": digest(found),
    }


def arrays_of(arrays) -> tuple[list[np.ndarray], dict[str, SensorViews]]:
    """Both clouds, and the keyword arguments of their views."""
    views = {}
    for time_of in ("before", "after"):
        if f"poses_{time_of}" in arrays:
            *field_of_view, max_range = arrays[f"sensor_{time_of}"]
            views[f"views_{time_of}"] = SensorViews(arrays[f"poses_{time_of}"], tuple(field_of_view), max_range)
    return [arrays["before"], arrays["after"]], views


def digest(found) -> str:
    """Of `changes.json` without settings and timings, and of all values of points, bit for bit."""
    record = {name: value for name, value in found.to_dict().items() if name not in ("config", "diagnostics")}
    sha = hashlib.sha256(json.dumps(record, sort_keys=True).encode())
    for name in ("labels", "probability", "unobserved"):
        for time_of in ("before", "after"):
            sha.update(np.ascontiguousarray(getattr(found, f"{name}_{time_of}")).tobytes())
    return sha.hexdigest()[:16]


if __name__ == "__main__":
    main()
