"""Simulated pairs of every family, and the candidates that detection finds in them."""

import dataclasses
import functools
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
    workers: int = 1,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Collected:
    """The candidates of the scenes of some families; the same whatever the number of workers.

    Args:
        families: of `LEARNED_FROM`.
        seeds: of the scenes of every family.
        workers: processes.
        progress: called with the family that was done and the share of the work.
    """
    tasks = [(family, seed) for family in families for seed in seeds]
    found: dict[str, list[Pair[CandidateRows]]] = {family: [] for family in families}
    failed = []
    of_tasks = over_workers(_of_scene, tasks, workers)
    for done, ((family, seed), rows) in enumerate(zip(tasks, of_tasks, strict=True), 1):
        progress(f"{family}, seed {seed}", done / len(tasks))
        if isinstance(rows, str):
            failed.append(f"{family}, seed {seed}: {rows}")
        else:
            found[family].append(rows)
    return Collected({family: _joined(parts) for family, parts in found.items()}, tuple(failed), tuple(seeds))


def collected_in(
    folder: Path,
    families: Sequence[str],
    seeds: Sequence[int],
    *,
    workers: int = 1,
    progress: Callable[[str, float], None] = lambda stage, share: None,
) -> Collected:
    """As `collected`, where the candidates of each family are kept in a file once they are there, and read from it.

    The scenes of a family are drawn from its own seeds: one can be collected anew by removing its file.

    Args:
        folder: of the files FAMILY.npz; made where it is missing.
        families: as of `collected`.
        seeds: likewise.
        workers: likewise.
        progress: likewise, the share of one family.

    Raises:
        InputError: a file that cannot be written, is damaged, or was made of other seeds or with other facts.
    """
    failed = list[str]()
    for family in families:
        collect = functools.partial(collected, [family], seeds, workers=workers, progress=progress)
        failed += kept_in(folder, family, seeds, collect).failed
    return Collected(_joined_files(folder, families), tuple(failed), tuple(seeds))


def kept_in(folder: Path, name: str, seeds: Sequence[int], collect: Callable[[], Collected]) -> Collected:
    """The candidates in a file of a folder; where it is missing they are collected, and kept in it.

    Args:
        folder: of the file NAME.npz; made where it is missing.
        name: of the family or the kind of scenes.
        seeds: of its scenes.
        collect: gives the candidates.

    Raises:
        InputError: a file that cannot be written, is damaged, or was made of other seeds or with other facts.
    """
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot make this folder: {error.strerror or error}") from error
    path = folder / f"{name}.npz"
    if not path.is_file():
        own = collect()
        write_rows(path, own)
        return own
    kept = read_rows(path)
    if kept.seeds != tuple(seeds):
        raise InputError(f"{path}: was collected from other seeds; remove it, or name another folder")
    return kept


def _joined_files(folder: Path, families: Sequence[str]) -> dict[str, Pair[CandidateRows]]:
    joined = {}
    for family in families:
        path = folder / f"{family}.npz"
        own = read_rows(path).families
        if family not in own:
            raise InputError(f"{path}: has candidates of {', '.join(own) or 'no family'}; collect them again")
        joined[family] = own[family]
    return joined


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
    """What the scene is registered at: as always, and in few voxels where it has more points."""
    few = ResolutionSettings(voxels=REGISTERED_VOXELS)
    dense = max(len(pair.before.points), len(pair.after.points)) > REGISTERED_VOXELS > 0
    return [ResolutionSettings(), *([few] if dense else [])]


def _joined(parts: list[Pair[CandidateRows]]) -> Pair[CandidateRows]:
    return Pair(
        CandidateRows.joined([part.before for part in parts], poses=False),
        CandidateRows.joined([part.after for part in parts], poses=True),
    )


def write_rows(path: Path, rows: Collected) -> None:
    """Writes the candidates to an archive of arrays.

    Args:
        path: of the file, .npz.
        rows: to write.

    Raises:
        InputError: the file cannot be written.
    """
    arrays = {
        f"{family}/{side}/{column}": values
        for family, pair in rows.families.items()
        for side, own in zip(NAMES, pair, strict=True)
        for column, values in own._asdict().items()
    }
    names = {f"names/{side}": np.array(names_of(poses=side == "after")) for side in NAMES}
    names["names/seeds"] = np.array(rows.seeds, int)
    try:
        with atomic_write(path) as file:
            np.savez_compressed(file, **arrays, **names)  # type: ignore[arg-type]
    except OSError as error:
        raise InputError(f"{path}: cannot write the candidates there: {error.strerror or error}") from error


def read_rows(path: Path) -> Collected:
    """Reads what `write_rows` wrote, or all files of a folder of `collected_in`.

    Raises:
        InputError: the file is missing or damaged, or was made with other facts.
    """
    if path.is_dir():
        names = [name for name in LEARNED_FROM if (path / f"{name}.npz").is_file()]
        if not names:
            raise InputError(f"{path}: has no candidates of a family; collect them there")
        drawn = {read_rows(path / f"{name}.npz").seeds for name in names}
        if len(drawn) > 1:
            raise InputError(f"{path}: its families were collected from different seeds; collect some of them again")
        return Collected(_joined_files(path, names), seeds=drawn.pop())
    arrays = load_arrays(path)
    remedy = "collect the candidates again"
    if not isinstance(arrays, dict):
        raise InputError(f"{path}: is no archive of candidates; {remedy}")
    seeds = tuple(arrays.pop("names/seeds", np.empty(0, int)).tolist())
    for side in NAMES:
        facts = arrays.pop(f"names/{side}", np.empty(0))
        if tuple(facts.tolist()) != names_of(poses=side == "after"):
            raise InputError(f"{path}: was made with other facts; {remedy}")
    families = dict.fromkeys(name.split("/")[0] for name in arrays)
    try:
        return Collected(
            {
                family: Pair(
                    *(CandidateRows(*(arrays[f"{family}/{side}/{column}"] for column in COLUMNS)) for side in NAMES)
                )
                for family in families
            },
            seeds=seeds,
        )
    except KeyError as error:
        raise InputError(f"{path}: lacks {error}; {remedy}") from error
