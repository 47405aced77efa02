"""`gmmjax evaluate pairs FOLDER`."""

import dataclasses
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import OmitArgPrefixes, Positional

from gmmjax.cli.evaluation import Options, run_evaluation
from gmmjax.errors import InputError

if TYPE_CHECKING:
    from gmmjax.evaluation import PairSource


def command(arguments: Sequence[str]) -> Callable[..., int]:
    """`evaluate_pairs`, whatever the arguments."""
    del arguments
    return evaluate_pairs


def evaluate_pairs(
    folder: Annotated[Positional[Path], tyro.conf.arg(metavar="FOLDER")],
    *,
    sensor_at_origin: Annotated[tuple[str, ...], tyro.conf.arg(metavar="PATTERN")] = (),
    poses: Literal["given", "unknown"] = "given",
    common: OmitArgPrefixes[Options] = Options(),
) -> int:
    """Score detectors on pairs of scans with truth: precision, recall, F1, false segments, times.

    Each pair is a folder with before.* and after.* (any format that detect reads), truth_before.npy and
    truth_after.npy (an integer for each point: -1 unchanged, else the id of the change, the same id on both sides for
    an object that moved), and optionally unseen_before.npy, unseen_after.npy, views_before.json and
    views_after.json.

    Args:
        folder: folder that contains the folders of the pairs.
        sensor_at_origin: pairs whose names fit one of these patterns, such as 'frame*', are single depth frames from a
            camera at the origin that looks along z.
        poses: "given": the detectors get the views that are known of a pair; "unknown": they get none.
        common: to all evaluations.
    """
    from gmmjax.evaluation import find_pairs

    common.check()
    sources = find_pairs(folder)
    for pattern in sensor_at_origin:
        if not any(fnmatchcase(source.name, pattern) for source in sources):
            names = ", ".join(source.name for source in sources)
            raise InputError(f"--sensor-at-origin {pattern}: fits none of the pairs {names}")
    placed = [_without_views(source) if poses == "unknown" else _placed(source, sensor_at_origin) for source in sources]
    return run_evaluation(placed, common, evidence=True)


def _without_views(source: "PairSource") -> "PairSource":
    return dataclasses.replace(source, load=lambda: source.load().without_views())


def _placed(source: "PairSource", patterns: Sequence[str]) -> "PairSource":
    from gmmjax.evaluation import at_origin

    if not any(fnmatchcase(source.name, pattern) for pattern in patterns):
        return source
    return dataclasses.replace(source, load=lambda: at_origin(source.load()))
