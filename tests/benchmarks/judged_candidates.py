"""How the verdict judges candidates of scenes that it was not learned from:

`python -m tests.benchmarks.judged_candidates --first-seed 100 --seeds 10 --workers 2`

With `--others others` it judges the candidates that `python -m tests.benchmarks.other_generators --out others` keeps,
in place of those of the families.
"""

import argparse
from pathlib import Path

import jax
import numpy as np

from gmmjax.changes import Verdict, Verdicts, read_verdicts, shipped_verdicts
from gmmjax.errors import InputError
from gmmjax.learning import LEARNED_FROM, CandidateRows, LeftOut, collected, left_out_table
from tests.benchmarks.other_generators import kept_candidates


def probabilities(verdict: Verdict, rows: CandidateRows) -> np.ndarray:
    """Of changed, not observed and unchanged, for each candidate [n, 3]."""
    with jax.enable_x64(True):
        return np.asarray(jax.vmap(verdict.probabilities)(rows.scaled(verdict.names)))


def table(verdicts: Verdicts, families: dict[str, CandidateRows], *, poses: bool) -> str:
    """A Markdown table with a row for each family."""
    verdict = verdicts.poses_given if poses else verdicts.poses_unknown
    judged = {name: probabilities(verdict, rows) for name, rows in families.items() if len(rows.kind)}
    return left_out_table(families, LeftOut(judged, 0.0, 1.0), heading="family")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--verdict", type=Path, help="default: the shipped one")
    parser.add_argument("--families", nargs="+", choices=LEARNED_FROM, default=list(LEARNED_FROM))
    parser.add_argument("--first-seed", type=int, default=100, help="beyond those of the training")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--others", type=Path, help="folder of candidates of other generators, to judge these")
    arguments = parser.parse_args()
    verdicts = shipped_verdicts() if arguments.verdict is None else read_verdicts(arguments.verdict)
    for poses, families in zip((False, True), _candidates(parser, arguments), strict=True):
        print(f"\n## Poses {'given' if poses else 'unknown'}\n")
        print(table(verdicts, families, poses=poses))


def _candidates(
    parser: argparse.ArgumentParser, arguments: argparse.Namespace
) -> tuple[dict[str, CandidateRows], dict[str, CandidateRows]]:
    """Those with the poses unknown, and those with the poses given."""
    if arguments.others is None:
        seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
        found = collected(arguments.families, seeds, workers=arguments.workers)
        return found.of(poses=False), found.of(poses=True)
    try:
        return kept_candidates(arguments.others, poses=False), kept_candidates(arguments.others, poses=True)
    except InputError as error:
        parser.error(f"--others {error}")


if __name__ == "__main__":
    main()
