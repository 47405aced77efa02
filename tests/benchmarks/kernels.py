"""The compiled kernels of this checkout and of another one: `python -m tests.benchmarks.kernels --against FOLDER`.

A process for each checkout and instruction set computes the same tasks in turns, with one thread; CPU seconds are the
median of the turns, of which the first compiles and is not counted. Without `--against` the instruction sets of this
checkout alone are compared.

The other checkout is a worktree of an earlier commit, with its kernels compiled, as of `checkouts`.
"""

import argparse
import contextlib
from pathlib import Path

from tests.benchmarks.checkouts import process
from tests.benchmarks.interleaved import Interleaved, load
from tests.benchmarks.kernels_process import TASKS
from tests.benchmarks.page import put

HERE = Path(__file__).resolve().parents[2]
PROCESS = Path(__file__).with_name("kernels_process.py")
SETS = "baseline", "avx2", "avx512"


def table(against: Path | None, sets: list[str], repeats: int) -> str:
    """A row for each task and instruction set."""
    columns = ["task", "instructions", *(["other, ms"] if against else []), "this, ms", *(["ratio"] if against else [])]
    lines = [f"| {' | '.join([*columns, 'load'])} |", "|---" * (len(columns) + 1) + "|"]
    with contextlib.ExitStack() as stack:
        computed = {
            (checkout, instructions): stack.enter_context(process(checkout, PROCESS, GMMJAX_INSTRUCTIONS=instructions))
            for checkout in filter(None, (against, HERE))
            for instructions in sets
        }
        for task in TASKS:
            turns = Interleaved({own: lambda run=run, task=task: run(task) for own, run in computed.items()})
            for _ in range(repeats + 1):
                turns.turn()
            for instructions in sets:
                own = 1e3 * turns.timings[HERE, instructions].cpu
                cells = [task, instructions]
                if against:
                    other = 1e3 * turns.timings[against, instructions].cpu
                    cells += [f"{other:.1f}", f"{own:.1f}", f"{other / own:.1f} x"]
                else:
                    cells.append(f"{own:.1f}")
                lines.append(f"| {' | '.join(cells)} | {load():.1f} |")
    return "\n".join(lines)


def sets_of_this_machine() -> list[str]:
    """The instruction sets that it has: in place of one that it lacks a narrower one would be timed."""
    flags = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    needed = {"baseline": "", "avx2": "avx2", "avx512": "avx512dq"}
    return [name for name in SETS if needed[name] in flags]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="the other checkout")
    parser.add_argument("--repeats", type=int, default=7, help="counted turns")
    parser.add_argument("--page", type=Path, help="a page with a place for the table; default: print it")
    arguments = parser.parse_args()
    against = None if arguments.against is None else arguments.against.resolve()
    put(arguments.page, "kernels", table(against, sets_of_this_machine(), arguments.repeats))


if __name__ == "__main__":
    main()
