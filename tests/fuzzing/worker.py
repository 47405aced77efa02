"""A process that reads mutants and reports how each ends, so that its own end can be laid at a mutant's door."""

import json
import resource
import shutil
import sys
import time
import traceback
import warnings
from pathlib import Path
from random import Random
from typing import Any

from gmmjax.errors import InputError, InputWarning


def main() -> None:
    """Answers requests, a line of JSON each: for every mutant a line before it is read, and one after."""
    from tests.fuzzing.planted import planted_targets
    from tests.fuzzing.targets import all_targets

    targets = all_targets() | planted_targets()
    for line in sys.stdin:
        request = json.loads(line)
        _limit_memory(2 * request["memory"])
        target, folder = targets[request["target"]], Path(request["folder"])
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        names = target.write(folder)
        files = [(own, (folder / own).read_bytes()) for own in names]
        for own, _ in files:
            _read_valid(target, folder / own)
        for index in range(request["start"], request["stop"]):
            _say({"index": index})
            _say({"index": index} | _outcome(target, files, index, request))
        _say({"index": None})


def _read_valid(target: Any, path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        target.read(path)


def _outcome(target: Any, files: list[tuple[str, bytes]], index: int, request: dict[str, Any]) -> dict[str, Any]:
    """How reading a mutant ends: "read", "refused", or "defect" with what is wrong."""
    name, content = target.mutant(files, Random(f"{request['seed']} {target.name} {index}"))
    folder = Path(request["folder"])
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
    if seconds > request["seconds"] or more > request["memory"]:
        outcome = {"outcome": "defect", "detail": f"took {seconds:.1f} s and {more / 2**30:.1f} GB"}
    path.write_bytes(dict(files)[name])
    return outcome | {"seconds": seconds}


def _peak_memory() -> int:
    """Of this process and those that it waited for, bytes."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    try:
        # The peak that getrusage tells of a process includes what its parent held when it was started.
        lines = Path("/proc/self/status").read_text().splitlines()
        own = next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
    except (OSError, StopIteration):
        own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return max(own, children) * 1024


def _limit_memory(more: int) -> None:
    """So many bytes beyond those that are taken; the machine is others' as well."""
    with open("/proc/self/statm", encoding="ascii") as statm:
        size = int(statm.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + more, resource.getrlimit(resource.RLIMIT_AS)[1]))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _say(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
