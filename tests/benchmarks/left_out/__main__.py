"""How families that were left out fare: `python -m tests.benchmarks.left_out --verdicts left-out --out left-out-table`.

For each family the verdict that was learned on all others (`python -m gmmjax.learning --left-out left-out`), beside the
peers at the setting, of a coarse series, that is the best for that very family, alone and with the evidence that ours
has, and beside another checkout: `git worktree add ../thresholds COMMIT`, `--against ../thresholds`. The scenes are not
those of training. Every family's result is kept in the folder; those of the same verdict that are there are not made
again: give another folder when the code has changed.
"""

import argparse
from pathlib import Path

from gmmjax.learning import LEARNED_FROM
from tests.benchmarks.left_out.jobs import Job, results
from tests.benchmarks.left_out.table import to_markdown


def main() -> None:
    options = parser()
    arguments = options.parse_args()
    if min(arguments.changed, arguments.workers) < 1 or min(arguments.unchanged, arguments.first_seed) < 0:
        options.error("--changed and --workers must be at least 1, --unchanged and --first-seed at least 0")
    for family in arguments.families:
        if not (arguments.verdicts / f"{family}.json").is_file():
            options.error(
                f"--verdicts {arguments.verdicts}: has no {family}.json; gmmjax.learning --left-out writes it"
            )
    if arguments.out.resolve() == arguments.verdicts.resolve():
        options.error(f"--out {arguments.out}: is the folder of the verdicts; give another one")
    if arguments.against and not (arguments.against / "gmmjax").is_dir():
        options.error(f"--against {arguments.against}: has no gmmjax; give the root of a checkout")
    arguments.out.mkdir(parents=True, exist_ok=True)
    text = to_markdown(results(jobs_of(arguments), arguments.out, arguments.workers))
    print(text)
    (arguments.out / "table.md").write_text(text)


def parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    result.add_argument(
        "--families",
        nargs="+",
        choices=LEARNED_FROM,
        default=list(LEARNED_FROM),
        metavar="FAMILY",
        help=", ".join(LEARNED_FROM),
    )
    result.add_argument("--verdicts", type=Path, required=True, help="folder with FAMILY.json, learned without it")
    result.add_argument("--out", type=Path, required=True, help="folder that results and table.md are written to")
    result.add_argument("--changed", type=int, default=3, help="pairs of each family in which something changed")
    result.add_argument("--unchanged", type=int, default=1, help="pairs of each family in which nothing did")
    result.add_argument("--first-seed", type=int, default=1000, help="that is tried; beyond those of training")
    result.add_argument("--against", type=Path, help="root of another checkout, whose detection is run, too")
    result.add_argument("--no-peers", action="store_true", help="leaves out the peers, which take most of the time")
    result.add_argument("--workers", type=int, default=1, help="processes")
    return result


def jobs_of(arguments: argparse.Namespace) -> list[Job]:
    """A job for each family."""
    return [
        Job(
            family,
            arguments.verdicts / f"{family}.json",
            arguments.changed,
            arguments.unchanged,
            arguments.first_seed,
            arguments.against,
            not arguments.no_peers,
        )
        for family in arguments.families
    ]


if __name__ == "__main__":
    main()
