"""A process that reads mutants and reports how each ends, so that its own end can be laid at a mutant's door."""

import json
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from random import Random
from typing import Any

from gmmjax.errors import InputError, InputWarning

SECONDS = 5.0
MEMORY = 2 << 30


def main() -> None:
    """Answers requests, a line of JSON each: for every mutant a line before it is read, and one after."""
    from tests.fuzzing.planted import planted_targets
    from tests.fuzzing.targets import all_targets

    targets = all_targets() | planted_targets()
    _limit_memory()
    with tempfile.TemporaryDirectory() as name:
        for line in sys.stdin:
            request = json.loads(line)
            target = targets[request["target"]]
            # The error must name the file, whose name no message has by chance.
            folder = Path(name) / "qzv"
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            names = target.write(folder)
            files = [(own, (folder / own).read_bytes()) for own in names]
            for own, _ in files:
                _read_valid(target, folder / own)
            for index in range(request["start"], request["stop"]):
                _say({"index": index})
                _say({"index": index} | _outcome(target, folder, files, f"{request['seed']} {target.name} {index}"))
            _say({"index": None})


def _read_valid(target: Any, path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        target.read(path)


def _outcome(target: Any, folder: Path, files: list[tuple[str, bytes]], seed: str) -> dict[str, Any]:
    """How reading the mutant of a seed ends: "read", "refused", or "defect" with what is wrong."""
    name, content = target.mutant(files, Random(seed))
    path = folder / name
    path.write_bytes(content)
    start, memory = time.process_time(), _peak_memory()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", InputWarning)
        try:
            target.read(path)
            outcome = {"outcome": "read"}
        except InputError as error:
            outcome = {"outcome": "refused", "detail": str(error)}
            if "\n" in str(error) or str(folder) not in str(error) or len(str(error)) > 2000:
                outcome = {
                    "outcome": "defect",
                    "detail": f"a message that is not one line with the name: {error}"[:2000],
                }
        except BaseException:
            outcome = {"outcome": "defect", "detail": traceback.format_exc()[-3000:]}
    seconds, more = time.process_time() - start, _peak_memory() - memory
    if seconds > SECONDS or more > MEMORY:
        outcome = {"outcome": "defect", "detail": f"took {seconds:.1f} s and {more / 2**30:.1f} GB"}
    path.write_bytes(dict(files)[name])
    return outcome | {"seconds": seconds}


def _peak_memory() -> int:
    """Of this process and those that it waited for, bytes."""
    return max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) * 1024


def _limit_memory() -> None:
    """Twice what is allowed, so that a reader that takes more can be told from one that asks for more than there is."""
    with open("/proc/self/statm", encoding="ascii") as statm:
        size = int(statm.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + 2 * MEMORY, size + 2 * MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _say(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
