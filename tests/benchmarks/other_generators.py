"""The candidates of generators that the verdict was not learned from:

`python -m tests.benchmarks.other_generators --kinds held-out --first-seed 30 --seeds 4 --out others`

Those of each kind are kept in a file, in which they are read in place of simulating scenes. What a verdict makes of
them, `python -m tests.benchmarks.judged_candidates --others others` tells, and of one that is learned without some
facts `python -m tests.benchmarks.without_facts --others others`.
"""

import argparse
import functools
import itertools
import warnings
from collections.abc import Sequence
from pathlib import Path

from gmmjax.changes import Scan
from gmmjax.errors import InputError, InputWarning
from gmmjax.learning import CandidateRows, Collected, PointTruth, kept_in, read_rows, rows_of, rows_of_scans
from gmmjax.learning.scene_workers import over_workers
from gmmjax.pair import Pair, each
from tests.benchmarks.held_out.kinds import KINDS, held_out_pair
from tests.benchmarks.surveyor import kinds as surveyor
from tests.benchmarks.surveyor.solids import UNJUDGED
from tests.benchmarks.surveyor.surveys import SurveyedPair

HELD_OUT = "held-out"
SURVEYED = (*surveyor.KINDS, *surveyor.HELD_OUT)


def collected_of(kind: str, seeds: Sequence[int], points: int, workers: int = 1) -> Collected:
    """The candidates of the scenes of one kind, each once with changes and once without.

    Args:
        kind: of `KINDS` or `SURVEYED`.
        seeds: of the scenes.
        points: a side, of the scenes of surveyors.
        workers: processes.
    """
    tasks = list(itertools.product(seeds, (True, False)))
    found = list(over_workers(functools.partial(_of_scene, kind=kind, points=points), tasks, workers))
    rows = Pair(
        CandidateRows.joined([own.before for own in found], poses=False),
        CandidateRows.joined([own.after for own in found], poses=True),
    )
    return Collected({kind: rows}, seeds=tuple(seeds))


def _of_scene(task: tuple[int, bool], kind: str, points: int) -> Pair[CandidateRows]:
    seed, changed = task
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        if kind in KINDS:
            return rows_of(held_out_pair(kind, seed, changed))
        return _of_survey(surveyor.simulated(kind, seed, points, changed=changed))


def _of_survey(pair: SurveyedPair) -> Pair[CandidateRows]:
    """Where nothing changed all points are judged, those too that the other survey could not see."""
    truths = pair.truth.map(lambda truth: PointTruth((truth != UNJUDGED) | pair.unchanged, truth >= 0))
    unknown, given = (rows_of_scans(each(Scan, pair.points, views), truths) for views in (Pair(None, None), pair.views))
    return Pair(unknown.before, given.after)


def kept_candidates(folder: Path, *, poses: bool) -> dict[str, CandidateRows]:
    """The candidates of each kind that are kept in a folder.

    Args:
        folder: of the files KIND.npz.
        poses: whether the poses are given.

    Raises:
        InputError: there are none, or a file is damaged or was made with other facts.
    """
    files = sorted(folder.glob("*.npz"))
    if not files:
        raise InputError(f"{folder}: has no candidates; collect them there")
    return {kind: own for file in files for kind, own in read_rows(file).of(poses=poses).items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", nargs="+", choices=(HELD_OUT, *KINDS, *SURVEYED), default=[HELD_OUT])
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--points", type=int, default=400_000, help="a side, of the scenes of surveyors")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="folder of the files KIND.npz")
    arguments = parser.parse_args()
    seeds = tuple(range(arguments.first_seed, arguments.first_seed + arguments.seeds))
    for kind in itertools.chain.from_iterable(KINDS if own == HELD_OUT else [own] for own in arguments.kinds):
        collect = functools.partial(collected_of, kind, seeds, arguments.points, arguments.workers)
        try:
            rows = kept_in(arguments.out, kind, seeds, collect).families[kind]
        except InputError as error:
            parser.error(str(error))
        print(f"{kind}: {len(rows.before.kind)} candidates, {len(rows.after.kind)} with poses", flush=True)


if __name__ == "__main__":
    main()
