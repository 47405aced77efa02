"""`python -m gmmjax.learning`: simulates scenes, learns the verdict from their candidates, and writes its file."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from gmmjax.changes import Verdicts, write_verdicts
from gmmjax.errors import InputError, check_choice
from gmmjax.learning.collection import LEARNED_FROM, Collected, collected
from gmmjax.learning.training import PENALTIES, learned, left_out_table


def main() -> int:
    """Learns the verdict on changes from simulated scenes, and prints how families that were left out are judged."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write the parameters there")
    parser.add_argument("--families", nargs="+", default=LEARNED_FROM, help="families of scenes")
    parser.add_argument("--seeds", type=int, default=48, help="scenes of every family")
    parser.add_argument("--first-seed", type=int, default=0, help="of each family")
    parser.add_argument("--workers", type=int, default=1, help="processes; the result does not depend on it")
    text = "keep the candidates of each family in a file there; those that are there are read again"
    parser.add_argument("--rows", type=Path, metavar="FOLDER", help=text)
    text = "write the verdict learned without a family to FAMILY.json there, for each of them"
    parser.add_argument("--left-out", type=Path, metavar="FOLDER", help=text)
    options = parser.parse_args()
    seeds, first_seed, out, left_out = options.seeds, options.first_seed, options.out, options.left_out
    try:
        found = _rows(tuple(options.families), range(first_seed, first_seed + seeds), options.workers, options.rows)
        verdicts, penalties = _learned(found)
        if out is not None:
            write_verdicts(out, verdicts, {"families": list(found.families), "seeds": seeds, "first_seed": first_seed})
        if left_out is not None:
            for family in found.families:
                others = found.without(family)
                made = {"families": list(others.families), "seeds": seeds, "first_seed": first_seed}
                write_verdicts(left_out / f"{family}.json", _learned(others, penalties, show=False)[0], made)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


def _rows(families: tuple[str, ...], seeds: range, workers: int, folder: Path | None) -> Collected:
    for family in families:
        check_choice("--families", family, LEARNED_FROM)
    found = collected(families, seeds, folder=folder, workers=workers, progress=_progress)
    for failure in found.failed:
        print(f"left out: {failure}", file=sys.stderr)
    return found


def _learned(
    found: Collected, penalties: Sequence[float] = PENALTIES, *, show: bool = True
) -> tuple[Verdicts, tuple[float, ...]]:
    """The verdicts without and with poses, and their penalties; shows how families that were left out are judged."""
    verdicts, chosen = [], []
    for poses in (False, True):
        families = found.of(poses=poses)
        verdict, left_out = learned(families, poses=poses, penalties=penalties)
        verdicts.append(verdict)
        chosen.append(left_out.penalty)
        if show:
            print(f"\n## Poses {'given' if poses else 'unknown'}\n")
            print(left_out_table(families, left_out))
            print(f"\nPenalty {left_out.penalty:g}, temperature {left_out.temperature:.3f}.")
    return Verdicts(*verdicts), tuple(dict.fromkeys(chosen))


def _progress(stage: str, share: float) -> None:
    if sys.stderr.isatty():
        print(f"\r{share:4.0%} {stage:60.60}", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
