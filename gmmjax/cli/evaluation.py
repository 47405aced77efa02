"""What the commands `gmmjax evaluate ...` have in common: their options, and what they print and write."""

import dataclasses
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from gmmjax._compilation_cache import use_compilation_cache
from gmmjax.changes import DetectionConfig
from gmmjax.cli.detect import read_settings
from gmmjax.cli.help_texts import record_with_help
from gmmjax.errors import ComputationError, InputError, check_seed
from gmmjax.evaluation import Name

if TYPE_CHECKING:
    from gmmjax.evaluation import Detector, Evaluation, PairSource, ReliabilityRecord

DONE, FAILED = 0, 1
TABLE_ENDINGS = (".csv", ".json", ".md")
CURVE_ENDINGS = (".png", ".svg", ".pdf", ".json", ".md")


@record_with_help
@dataclasses.dataclass(frozen=True)
class Options:
    """Which detectors are scored, and where the figures go.

    Attributes:
        methods: detectors to score; default all that can run here. Those of m3c2 need the extra `peers`; "+evidence"
            applies the evidence test of "joint" to a detector's segments.
        restarts: random starts of the fits; default as for each method.
        config: TOML file with settings for our detectors, such as one that `gmmjax tune` wrote.
        out: also write the table to this file, .csv, .json or .md.
        reliability: write the reliability curves of the reported probabilities to this file; .png, .svg and .pdf draw
            them, .json and .md have them as a table.
        json: print JSON and nothing else.
        csv: print comma-separated values and nothing else.
        quiet: print nothing but errors.
    """

    methods: tuple[Name, ...] = ()
    restarts: int | None = None
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE.toml")] = None
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    reliability: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    json: bool = False
    csv: bool = False
    quiet: bool = False

    def check(self) -> None:
        """Finds out what cannot be done before the work begins.

        Raises:
            InputError: files that cannot be written.
        """
        for flag, path, endings in (
            ("--out", self.out, TABLE_ENDINGS),
            ("--reliability", self.reliability, CURVE_ENDINGS),
        ):
            if path is not None and path.suffix not in endings:
                raise InputError(f"{flag} {path}: the ending must be one of {', '.join(endings)}")
            if path is not None and not path.resolve().parent.is_dir():
                raise InputError(f"{flag} {path}: there is no folder {path.parent}; make it first")


def seed_range(first: int, count: int) -> range:
    """The seeds of an evaluation.

    Raises:
        InputError: none, or negative ones.
    """
    if count < 1:
        raise InputError(f"--seeds {count} must be at least 1")
    check_seed("--first-seed", first)
    return range(first, first + count)


def fitting(sources: Sequence["PairSource"], patterns: Sequence[str]) -> list["PairSource"]:
    """The sources whose condition fits one of some shell patterns.

    Raises:
        InputError: a pattern that fits none.
    """
    for pattern in patterns:
        if not any(fnmatchcase(source.condition, pattern) for source in sources):
            names = dict.fromkeys(source.condition for source in sources)
            raise InputError(f"--conditions {pattern}: fits none of {'; '.join(names)}")
    return [source for source in sources if any(fnmatchcase(source.condition, pattern) for pattern in patterns)]


def run_evaluation(sources: Sequence["PairSource"], options: Options, *, evidence: bool) -> int:
    """Evaluates, prints and writes.

    Args:
        sources: the pairs.
        options: of the command.
        evidence: whether the detectors with the evidence test are among the default ones.

    Returns:
        The exit status: 1 where some pair failed.

    Raises:
        InputError: m3c2 is asked for and not installed.
        ComputationError: every pair failed.
    """
    from gmmjax.evaluation import ReliabilityRecord, available, detector, evaluate
    from gmmjax.reporting import console

    names = options.methods or available(evidence=evidence)
    if missing := [name for name in names if name not in available()]:
        raise InputError(f"--methods {' '.join(missing)}: needs py4dgeo; pip install '.[peers]', or leave it out")
    config = DetectionConfig() if options.config is None else read_settings(options.config)
    if options.restarts is not None:
        config = dataclasses.replace(config, restarts=options.restarts)
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

    as_table = {".csv": tables.to_csv, ".json": tables.to_json, ".md": tables.to_markdown}
    if options.out is not None:
        with atomic_write(options.out) as file:
            file.write(as_table[options.out.suffix](evaluation).encode())
    if options.reliability is not None:
        _write_reliability(options.reliability, record)


def _write_reliability(path: Path, record: "ReliabilityRecord") -> None:
    from gmmjax.clouds import atomic_write
    from gmmjax.plotting import reliability_figure, write_figure

    if path.suffix not in (".json", ".md"):
        write_figure(path, reliability_figure(record))
        return
    with atomic_write(path) as file:
        file.write((record.to_json() if path.suffix == ".json" else record.to_markdown()).encode())


def _print(evaluation: "Evaluation", options: Options) -> None:
    from gmmjax.evaluation import tables
    from gmmjax.reporting import console

    if options.json:
        print(tables.to_json(evaluation))
    elif options.csv:
        print(tables.to_csv(evaluation), end="")
    elif not options.quiet:
        console.print_evaluation(evaluation)
