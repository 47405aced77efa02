"""How families that were left out are judged without some facts, beside all of them:

`python -m tests.benchmarks.without_facts --rows rows --facts unreached interspersed differing_elsewhere`

The rows are those that `python -m gmmjax.learning --rows rows` keeps. With `--others others` the candidates that
`python -m tests.benchmarks.other_generators --out others` keeps are judged, too, by what is learned on all families:
a table for each folder.
"""

import argparse
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from gmmjax.changes import FACTS, names_of
from gmmjax.errors import InputError
from gmmjax.learning import CandidateRows, LeftOut, TrainingSettings, learned, left_out_table, read_rows
from tests.benchmarks.judged_candidates import probabilities
from tests.benchmarks.other_generators import kept_candidates


def without(rows: CandidateRows, facts: Collection[str], *, poses: bool) -> CandidateRows:
    """The candidates, of which some facts are all the same: these say nothing.

    Args:
        rows: the candidates.
        facts: to leave out.
        poses: whether the poses are given.
    """
    values = rows.values.copy()
    values[:, [name in facts for name in names_of(poses=poses)]] = 0.0
    return rows._replace(values=values)


def tables(
    families: Mapping[str, CandidateRows],
    others: Sequence[Mapping[str, CandidateRows]],
    facts: Collection[str],
    *,
    poses: bool,
    settings: TrainingSettings,
) -> Iterator[str]:
    """Markdown tables: of the families, each judged by what was learned on all others, and of other generators.

    Args:
        families: the candidates of each.
        others: those of other generators, of each kind; a table each.
        facts: to leave out.
        poses: whether the poses are given.
        settings: how the verdict is learned.
    """
    families, *others = (
        {name: without(own, facts, poses=poses) for name, own in rows.items() if len(own.kind)}
        for rows in (families, *others)
    )
    verdict, left_out = learned(families, poses=poses, settings=settings)
    yield left_out_table(families, left_out)
    for kinds in others:
        judged = {name: probabilities(verdict, own) for name, own in kinds.items()}
        yield left_out_table(kinds, LeftOut(judged, left_out.penalty, left_out.temperature), "other generator")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=Path, required=True)
    parser.add_argument("--others", type=Path, nargs="+", default=[], help="folders of candidates of other generators")
    parser.add_argument("--facts", nargs="+", choices=list(FACTS), metavar="FACT", required=True)
    parser.add_argument("--poses", choices=("unknown", "given", "both"), default="both")
    parser.add_argument("--penalties", type=float, nargs="+", default=list(TrainingSettings().penalties))
    arguments = parser.parse_args()
    settings = TrainingSettings(penalties=tuple(arguments.penalties))
    collected = read_rows(arguments.rows)
    for name in ("unknown", "given") if arguments.poses == "both" else (arguments.poses,):
        poses = name == "given"
        try:
            others = [kept_candidates(folder, poses=poses) for folder in arguments.others]
        except InputError as error:
            parser.error(f"--others {error}")
        for facts in ((), arguments.facts):
            print(f"\n## Poses {name}, {'without ' + ', '.join(facts) if facts else 'with all facts'}", flush=True)
            for table in tables(collected.of(poses=poses), others, facts, poses=poses, settings=settings):
                print(f"\n{table}", flush=True)


if __name__ == "__main__":
    main()
