"""`python -m gmmjax.learning`: simulates scenes, learns the verdict from their candidates, and writes its file."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from gmmjax.changes import Verdicts, write_verdicts
from gmmjax.errors import InputError, check_choice
from gmmjax.learning.collection import LEARNED_FROM, Collected, collected, collected_in
from gmmjax.learning.training import TrainingSettings, learned, left_out_table


def main(
    *,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE.json")] = None,
    families: tuple[str, ...] = LEARNED_FROM,
    seeds: int = 48,
    first_seed: int = 0,
    workers: int = 1,
    rows: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None,
    left_out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None,
) -> int:
    """Learn the verdict on changes from simulated scenes, and print how families that were left out are judged.

    Args:
        out: write the parameters there.
        families: of scenes.
        seeds: scenes of every family.
        first_seed: of each family.
        workers: processes; the result does not depend on it.
        rows: keep the candidates of each family in a file there; those that are there are read in place of simulating
            scenes, so that an interrupted run goes on.
        left_out: write the verdict learned without a family to FAMILY.json there, for each of them.
    """
    try:
        found = _rows(families, range(first_seed, first_seed + seeds), workers, rows)
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
    if folder is None:
        found = collected(families, seeds, workers=workers, progress=_progress)
    else:
        found = collected_in(folder, families, seeds, workers=workers, progress=_progress)
    for failure in found.failed:
        print(f"left out: {failure}", file=sys.stderr)
    return found


def _learned(
    found: Collected, penalties: Sequence[float] = TrainingSettings().penalties, *, show: bool = True
) -> tuple[Verdicts, tuple[float, ...]]:
    """The verdicts without and with poses, and their penalties; shows how families that were left out are judged."""
    verdicts, chosen = [], []
    for poses in (False, True):
        families = found.of(poses=poses)
        verdict, left_out = learned(families, poses=poses, settings=TrainingSettings(penalties=tuple(penalties)))
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
    sys.exit(tyro.cli(main))
