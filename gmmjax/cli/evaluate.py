"""`gmmjax evaluate gaussians`, `laboratory`, `scenes` and `pairs`: their options, and what they print and write."""

import dataclasses
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.cli.detect import read_settings
from gmmjax.cli.options import check_output_file
from gmmjax.errors import ComputationError, InputError, check_seed
from gmmjax.evaluation import Name

if TYPE_CHECKING:
    from gmmjax.evaluation import Detector, Evaluation, PairSource, ReliabilityRecord

DONE, FAILED = 0, 1
Poses = Literal["given", "unknown"]
Family = Literal["thesis", "separation", "few-points", "sparse", "shifted"]


@dataclasses.dataclass(frozen=True)
class Options:
    """Which detectors are scored, and where the figures go.

    Attributes:
        methods: detectors to score. Default: all that can run here. Those of m3c2 need the extra `peers`; "+evidence"
            applies the evidence test of "joint" to a detector's segments.
        restarts: random starts of the fits. Default: as for each method.
        config: settings for our detectors, such as those that `gmmjax tune` wrote.
        out: also write the table to this file, .csv, .json or .md.
        reliability: write the reliability curves of the reported probabilities to this file: .png, .svg and .pdf
            draw them, .json has their figures.
        json: print JSON and nothing else.
        quiet: print nothing but errors.

    Raises:
        InputError: files that cannot be written.
    """

    methods: Annotated[tuple[Name, ...], "METHOD ..."] = ()
    restarts: int | None = None
    config: Annotated[Path | None, "FILE.toml"] = None
    out: Path | None = None
    reliability: Path | None = None
    json: bool = False
    quiet: bool = False

    def __post_init__(self) -> None:
        """Finds out what cannot be done before the work begins."""
        if self.out is not None:
            check_output_file("--out", self.out, (".csv", ".json", ".md"), overwrite=True)
        if self.reliability is not None:
            check_output_file("--reliability", self.reliability, (".png", ".svg", ".pdf", ".json"), overwrite=True)


Common = Annotated[dict[str, Any], Options]


def evaluate_gaussians(
    *,
    families: tuple[Family, ...] = ("thesis",),
    conditions: Annotated[tuple[str, ...], "PATTERN ..."] = ("*",),
    seeds: int = 10,
    first_seed: int = 0,
    points: int | None = None,
    common: Common,
) -> int:
    """Score detectors on artificial scenes of five Gaussians: precision, recall, F1, false segments, times.

    Args:
        families: "thesis": (+1) (+2) (-1) (-2) (-1 +1) (none) (-2 +2) (-1 +3) (-3 +1) with low and medium overlap;
            "separation": one gone and one new, 0.25 to 2 standard deviations apart; "few-points": the same with 60 and
            200 points; "sparse": an after cloud 0.4 times as dense; "shifted": one displaced by 0.1 m on each axis.
        conditions: only those whose names fit one of these patterns, such as '(-1 +1)*' or '*medium*'.
        seeds: scenes of each condition.
        first_seed: first seed of the scenes; the others follow.
        points: points drawn from each Gaussian. Default: the condition's own, 1,000 unless it says otherwise.
        common: to all evaluations.
    """
    from gmmjax.evaluation import gaussian_sources

    options = Options(**common)
    if points is not None and points < 1:
        raise InputError(f"--points {points} must be at least 1")
    sources = gaussian_sources(_seeds(first_seed, seeds), families, points=points)
    return _evaluated(_fitting(sources, conditions), options, evidence=False)


def evaluate_laboratory(
    *,
    levels: tuple[Literal["normal", "hard"], ...] = ("normal",),
    surveys: tuple[Literal["panorama", "frame"], ...] = ("panorama",),
    poses: tuple[Poses, ...] = ("given", "unknown"),
    conditions: Annotated[tuple[str, ...], "PATTERN ..."] = ("*",),
    seeds: int = 5,
    first_seed: int = 0,
    common: Common,
) -> int:
    """Score detectors on simulated surveys of a room of 2 m, by a depth camera, in which objects of 0.3 m change.

    Args:
        levels: "hard" has more noise and misregistration, and a quarter of the frames is lost.
        surveys: "panorama": 16 frames from around the room; "frame": a single one.
        poses: whether the detectors are told where the camera stood.
        conditions: only those that fit one of these patterns: (+1) (+2) (+3) (-1) (-2) (-1 +1) (-2 +2) (moved) (none).
        seeds: scenes of each condition.
        first_seed: first seed of the scenes; the others follow.
        common: to all evaluations.
    """
    from gmmjax.evaluation import laboratory_sources

    options, chosen = Options(**common), _seeds(first_seed, seeds)
    sources = [
        source
        for survey in surveys
        for level in levels
        for known in poses
        for source in laboratory_sources(chosen, level=level, survey=survey, poses=known)
    ]
    return _evaluated(_fitting(sources, conditions), options)


def evaluate_scenes(
    *,
    families: Annotated[tuple[str, ...], "FAMILY ..."] = (),
    poses: tuple[Poses, ...] = ("given", "unknown"),
    seeds: int = 5,
    first_seed: int = 0,
    common: Common,
) -> int:
    """Score detectors on simulated surveys of places of many kinds, by depth cameras and laser scanners.

    Args:
        families: kinds of places, such as rooms, station, corridors. Default: all. A wrong name lists them.
        poses: whether the detectors are told where the sensor stood.
        seeds: scenes of each family.
        first_seed: first seed of the scenes; the others follow.
        common: to all evaluations.
    """
    from gmmjax.evaluation import family_sources
    from gmmjax.scenes import FAMILIES

    options, chosen = Options(**common), _seeds(first_seed, seeds)
    if unknown := [name for name in families if name not in FAMILIES]:
        raise InputError(f"--families {' '.join(unknown)}: there is no such family; choose from {', '.join(FAMILIES)}")
    sources = [source for known in poses for source in family_sources(families or tuple(FAMILIES), chosen, poses=known)]
    return _evaluated(sources, options)


def evaluate_pairs(
    folder: Annotated[Path, "FOLDER"],
    *,
    poses: Poses = "given",
    common: Common,
) -> int:
    """Score detectors on pairs of scans with truth: precision, recall, F1, false segments, times.

    Each pair is a folder with before.* and after.* (any format that detect reads), truth_before.npy and
    truth_after.npy (an integer for each point: -1 unchanged, else the id of the change, the same id on both sides for
    an object that moved), and optionally unseen_before.npy, unseen_after.npy, views_before.json and
    views_after.json.

    Args:
        folder: folder that holds one folder for each pair.
        poses: "given": the detectors get the views that are known of a pair; "unknown": they get none.
        common: to all evaluations.
    """
    from gmmjax.evaluation import find_pairs

    options, sources = Options(**common), find_pairs(folder)
    return _evaluated([source.without_views() for source in sources] if poses == "unknown" else sources, options)


def _seeds(first: int, count: int) -> range:
    if count < 1:
        raise InputError(f"--seeds {count} must be at least 1")
    check_seed("--first-seed", first)
    return range(first, first + count)


def _fitting(sources: Sequence["PairSource"], patterns: Sequence[str]) -> list["PairSource"]:
    """The sources whose condition fits one of some shell patterns, each of which must fit one."""
    for pattern in patterns:
        if not any(fnmatchcase(source.condition, pattern) for source in sources):
            names = dict.fromkeys(source.condition for source in sources)
            raise InputError(f"--conditions {pattern}: fits none of {'; '.join(names)}")
    return [source for source in sources if any(fnmatchcase(source.condition, pattern) for pattern in patterns)]


def _evaluated(sources: Sequence["PairSource"], options: Options, *, evidence: bool = True) -> int:
    """Evaluates, prints and writes; 1 where some pair failed.

    Raises:
        InputError: m3c2 is asked for and not installed.
        ComputationError: every pair failed.
    """
    from gmmjax.evaluation import ReliabilityRecord, available, detector, evaluate
    from gmmjax.reporting import console

    names = options.methods or available(evidence=evidence)
    if missing := [name for name in names if name not in available()]:
        raise InputError(f"--methods {' '.join(missing)}: needs py4dgeo; pip install '.[peers]', or leave it out")
    config = read_settings(options.config, {} if options.restarts is None else {"restarts": options.restarts})
    detectors: dict[str, Detector] = {name: detector(name, config) for name in names}
    record = ReliabilityRecord()
    use_compilation_cache()
    quiet = options.quiet
    with console.shown_warnings(quiet=quiet), console.progress_bar(quiet=quiet) as progress:
        evaluation = evaluate(detectors, sources, progress=progress, record=record.add)
    if not any(row.pairs for row in evaluation.rows):
        raise ComputationError(f"nothing could be evaluated: {evaluation.failures[0]}")
    _write(evaluation, record, options)
    _print(evaluation, options)
    console.print_failures(evaluation.failures)
    return FAILED if evaluation.failures else DONE


def _write(evaluation: "Evaluation", record: "ReliabilityRecord", options: Options) -> None:
    from gmmjax.clouds import atomic_write
    from gmmjax.evaluation import tables
    from gmmjax.plotting import reliability_figure, write_figure

    as_table = {".csv": tables.to_csv, ".json": tables.to_json, ".md": tables.to_markdown}
    texts = {} if options.out is None else {options.out: as_table[options.out.suffix](evaluation)}
    if options.reliability is not None and options.reliability.suffix == ".json":
        texts[options.reliability] = record.to_json()
    elif options.reliability is not None:
        write_figure(options.reliability, reliability_figure(record))
    for path, text in texts.items():
        with atomic_write(path) as file:
            file.write(text.encode())


def _print(evaluation: "Evaluation", options: Options) -> None:
    from gmmjax.evaluation import tables
    from gmmjax.reporting import console

    if options.json:
        print(tables.to_json(evaluation))
    elif not options.quiet:
        console.print_evaluation(evaluation)
