"""How families that were left out are judged without some facts, beside all of them:

`python -m tests.benchmarks.without_facts --rows rows --facts unreached interspersed differing_elsewhere`

The rows are those that `python -m gmmjax.learning --rows rows` keeps.
"""

import argparse
from collections.abc import Collection
from pathlib import Path

from gmmjax.changes import FACTS, names_of
from gmmjax.learning import CandidateRows, TrainingSettings, judged_left_out, left_out_table, read_rows


def without(rows: CandidateRows, facts: Collection[str], *, poses: bool) -> CandidateRows:
    """The candidates without the columns of some facts.

    Args:
        rows: the candidates, with all facts.
        facts: to leave out.
        poses: whether the poses are given.
    """
    kept = [column for column, name in enumerate(names_of(poses=poses)) if name not in facts]
    return rows._replace(values=rows.values[:, kept])


def table(rows: Path, facts: Collection[str], *, poses: bool, settings: TrainingSettings) -> str:
    """A Markdown table of the families, each judged by what was learned on all others without the facts."""
    families = {name: without(own, facts, poses=poses) for name, own in read_rows(rows).of(poses=poses).items()}
    names = [name for name in names_of(poses=poses) if name not in facts]
    return left_out_table(families, judged_left_out(families, names, settings))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=Path, required=True)
    parser.add_argument("--facts", nargs="+", choices=list(FACTS), metavar="FACT", required=True)
    parser.add_argument("--poses", choices=("unknown", "given", "both"), default="both")
    parser.add_argument("--penalties", type=float, nargs="+", default=list(TrainingSettings().penalties))
    arguments = parser.parse_args()
    settings = TrainingSettings(penalties=tuple(arguments.penalties))
    for name in ("unknown", "given") if arguments.poses == "both" else (arguments.poses,):
        for facts in ((), arguments.facts):
            print(f"\n## Poses {name}, {'without ' + ', '.join(facts) if facts else 'with all facts'}\n")
            print(table(arguments.rows, facts, poses=name == "given", settings=settings), flush=True)


if __name__ == "__main__":
    main()
