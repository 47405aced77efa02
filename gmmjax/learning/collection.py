"""Simulated pairs of every family, and the candidates that detection finds in them."""

import dataclasses
import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import get_args

import numpy as np

from gmmjax.changes import NAMES, ResolutionSettings, names_of
from gmmjax.clouds import atomic_write, load_arrays
from gmmjax.errors import ComputationError, InputError, InputWarning, check_choice
from gmmjax.evaluation import CONDITIONS, LabelledPair, PairSource, family_sources, laboratory_sources
from gmmjax.learning.candidate_rows import CandidateRows, rows_of
from gmmjax.learning.scene_workers import over_workers
from gmmjax.pair import Pair
from gmmjax.scenes import FAMILIES, Difficulty, SurveyKind

LABORATORY = "laboratory"
LEARNED_FROM = (LABORATORY, *FAMILIES)
COLUMNS = CandidateRows._fields
# Scenes are registered once more in at most this number of voxels. Clouds of more points are then examined at their own
# resolution at each place, as dense scans are: such candidates are learned from, too. 0: they are not.
REGISTERED_VOXELS = 8_000


@dataclasses.dataclass(frozen=True)
class Collected:
    """The candidates of every family.

    Attributes:
        families: with the poses unknown, and with the poses given.
        failed: the scenes that detection refused, by name.
        seeds: of the scenes of every family.
    """

    families: Mapping[str, Pair[CandidateRows]]
    failed: tuple[str, ...] = ()
    seeds: tuple[int, ...] = ()

    def without(self, family: str) -> "Collected":
        """The candidates of all other families."""
        others = {name: own for name, own in self.families.items() if name != family}
        return dataclasses.replace(self, families=others)

    def of(self, *, poses: bool) -> dict[str, CandidateRows]:
        """The candidates of each family.

        Args:
            poses: whether the poses are given.
        """
        return {name: own.after if poses else own.before for name, own in self.families.items()}


def training_sources(family: str, seeds: Sequence[int]) -> list[PairSource]:
    """The scenes of a family, with views.

    Args:
        family: of `LEARNED_FROM`.
        seeds: one scene for each; of the laboratory with every seed another condition, survey and level.

    Raises:
        InputError: an unknown family.
    """
    check_choice("family", family, LEARNED_FROM)
    if family != LABORATORY:
        return family_sources([family], seeds, poses="given")
    kinds = list(itertools.product(get_args(SurveyKind), get_args(Difficulty)))
    sources = []
    for seed in seeds:
        survey, level = kinds[seed % len(kinds)]
        conditions = laboratory_sources([seed], level=level, survey=survey)
        sources.append(conditions[seed // len(kinds) % len(CONDITIONS)])
    return sources


def collected(
    families: Sequence[str],
    seeds: Sequence[int],
    *,
    folder: Path | None = None,
    workers: int = 1,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Collected:
    """The candidates of the scenes of some families; the same whatever the number of workers.

    Args:
        families: of `LEARNED_FROM`.
        seeds: of the scenes of every family.
        folder: for a file FAMILY.npz of each, which is read where it is there, so that an interrupted collection goes
            on, and a family is collected anew by removing its file; made where it is missing. None: nothing is kept.
        workers: processes.
        progress: called with the scene that was done and the share of its family's.

    Raises:
        InputError: a file that cannot be written, is damaged, or was made of other seeds or with other facts.
    """
    if folder is not None:
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot make this folder: {error.strerror or error}") from error
    found, failed = {}, list[str]()
    for family in families:
        path = None if folder is None else folder / f"{family}.npz"
        if path is not None and path.is_file():
            found[family], drawn = _read_family(path)
            if drawn != tuple(seeds):
                raise InputError(f"{path}: was collected from other seeds; remove it, or name another folder")
            continue
        found[family], refused = _of_family(family, seeds, workers, progress)
        failed += refused
        if path is not None:
            _write_family(path, found[family], seeds)
    return Collected(found, tuple(failed), tuple(seeds))


def read_rows(folder: Path) -> Collected:
    """Reads all files of a folder of `collected`.

    Raises:
        InputError: a file is damaged, or was made with other facts, or from other seeds than another.
    """
    names = [name for name in LEARNED_FROM if (folder / f"{name}.npz").is_file()]
    if not names:
        raise InputError(f"{folder}: has no candidates of a family; collect them there")
    read = {name: _read_family(folder / f"{name}.npz") for name in names}
    drawn = {seeds for _, seeds in read.values()}
    if len(drawn) > 1:
        raise InputError(f"{folder}: its families were collected from different seeds; collect some of them again")
    return Collected({name: rows for name, (rows, _) in read.items()}, seeds=drawn.pop())


def _of_family(
    family: str, seeds: Sequence[int], workers: int, progress: Callable[[str, float], None]
) -> tuple[Pair[CandidateRows], list[str]]:
    """The candidates of a family, and the scenes that detection refused."""
    parts, refused = [], []
    of_scenes = over_workers(_of_scene, [(family, seed) for seed in seeds], workers)
    for done, (seed, rows) in enumerate(zip(seeds, of_scenes, strict=True), 1):
        progress(f"{family}, seed {seed}", done / len(seeds))
        if isinstance(rows, str):
            refused.append(f"{family}, seed {seed}: {rows}")
        else:
            parts.append(rows)
    return _joined(parts), refused


def _of_scene(task: tuple[str, int]) -> Pair[CandidateRows] | str:
    """The candidates of one scene, or why there are none."""
    family, seed = task
    (source,) = training_sources(family, [seed])
    pair = source.load()
    with warnings.catch_warnings():
        # Doubtful registrations are a part of what is learned.
        warnings.simplefilter("ignore", InputWarning)
        try:
            return _joined([rows_of(pair, resolution=resolution) for resolution in _resolutions(pair)])
        except (InputError, ComputationError) as error:
            return str(error)


def _resolutions(pair: LabelledPair) -> list[ResolutionSettings]:
    """The resolutions that the scene is registered at: the usual one, and few voxels where it has more points."""
    few = ResolutionSettings(voxels=REGISTERED_VOXELS)
    dense = max(len(pair.before.points), len(pair.after.points)) > REGISTERED_VOXELS > 0
    return [ResolutionSettings(), *([few] if dense else [])]


def _joined(parts: list[Pair[CandidateRows]]) -> Pair[CandidateRows]:
    return Pair(
        CandidateRows.joined([part.before for part in parts], poses=False),
        CandidateRows.joined([part.after for part in parts], poses=True),
    )


def _write_family(path: Path, rows: Pair[CandidateRows], seeds: Sequence[int]) -> None:
    arrays = {
        f"{side}/{column}": values
        for side, own in zip(NAMES, rows, strict=True)
        for column, values in own._asdict().items()
    }
    names = {f"names/{side}": np.array(names_of(poses=side == "after")) for side in NAMES}
    try:
        with atomic_write(path) as file:
            np.savez_compressed(file, **arrays, **names, seeds=np.array(seeds, int))  # type: ignore[arg-type]
    except OSError as error:
        raise InputError(f"{path}: cannot write the candidates there: {error.strerror or error}") from error


def _read_family(path: Path) -> tuple[Pair[CandidateRows], tuple[int, ...]]:
    """The candidates of a family, and the seeds of its scenes."""
    arrays, remedy = load_arrays(path), "collect the candidates again"
    if not isinstance(arrays, dict):
        raise InputError(f"{path}: is no archive of candidates; {remedy}")
    try:
        for side in NAMES:
            if tuple(arrays[f"names/{side}"].tolist()) != names_of(poses=side == "after"):
                raise InputError(f"{path}: was made with other facts; {remedy}")
        rows = Pair(*NAMES).map(lambda side: CandidateRows(*(arrays[f"{side}/{column}"] for column in COLUMNS)))
        return rows, tuple(arrays["seeds"].tolist())
    except KeyError as error:
        raise InputError(f"{path}: lacks {error}; {remedy}") from error
