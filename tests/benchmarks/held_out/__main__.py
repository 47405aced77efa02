"""How detectors do on scenes that nothing was trained on: `python -m tests.benchmarks.held_out --seeds 2`.

For each kind of scene, with the sensors' poses and without, a line of figures for each detector; below, how far the
probabilities of all of them can be believed. With `--peers-best` each peer is given the setting, of a coarse series,
that is the best for that very kind.
"""

import argparse
from pathlib import Path
from typing import get_args

from gmmjax.evaluation import NAMES
from tests.benchmarks.held_out.jobs import Job, results
from tests.benchmarks.held_out.kinds import KINDS, Poses
from tests.benchmarks.held_out.records import pooled
from tests.benchmarks.held_out.table import to_markdown


def main() -> None:
    options = parser()
    arguments = options.parse_args()
    if min(arguments.seeds, arguments.workers) < 1 or arguments.first_seed < 0:
        options.error("--seeds and --workers must be at least 1, --first-seed at least 0")
    if arguments.out and not arguments.out.parent.is_dir():
        options.error(f"--out {arguments.out}: there is no folder {arguments.out.parent}")
    jobs = jobs_of(arguments)
    done = list(results(jobs, arguments.workers))
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


if __name__ == "__main__":
    main()
