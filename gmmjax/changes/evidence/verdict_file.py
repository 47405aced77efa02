"""The file of the verdicts: JSON, versioned, with the names of the facts."""

import dataclasses
import functools
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmmjax.changes.evidence.facts import names_of
from gmmjax.changes.evidence.verdict import Verdict
from gmmjax.clouds import atomic_write, read_json_record
from gmmjax.errors import InputError

SCHEMA_VERSION = 2
SHIPPED = Path(__file__).with_name("verdict.json")
REMEDY = "write it with this version's `python -m gmmjax.learning` or `gmmjax tune`"
SLOPES = ("changed_below", "changed_above", "unobserved_below", "unobserved_above")
COLUMNS = (*SLOPES, "bend", "centre", "spread", "lower", "upper")
ODDS = ("changed", "unobserved")


@dataclasses.dataclass(frozen=True)
class Verdicts:
    """The verdict without and with known poses.

    Attributes:
        poses_unknown: of candidates in places where the views of the other survey are not known.
        poses_given: where they are.
    """

    poses_unknown: Verdict
    poses_given: Verdict


def write_verdicts(path: str | os.PathLike[str], verdicts: Verdicts, made: Mapping[str, Any]) -> None:
    """Writes the verdicts.

    Args:
        path: of the file.
        verdicts: to write; their numbers are rounded to six digits.
        made: plain values that say how they were learned.

    Raises:
        InputError: the file cannot be written.
    """
    content = {
        "schema_version": SCHEMA_VERSION,
        "made": dict(made),
        "poses_unknown": _plain(verdicts.poses_unknown),
        "poses_given": _plain(verdicts.poses_given),
    }
    try:
        with atomic_write(Path(path)) as file:
            file.write((json.dumps(content, indent=1, allow_nan=False) + "\n").encode())
    except OSError as error:
        raise InputError(f"{path}: cannot write the verdicts there: {error.strerror or error}") from error


def read_verdicts(path: str | os.PathLike[str]) -> Verdicts:
    """Reads what `write_verdicts` wrote.

    Raises:
        InputError: a file that is missing, damaged, of another version, without a fact, or with a number that is none.
    """
    content = read_json_record(Path(path), SCHEMA_VERSION, REMEDY)
    return Verdicts(
        _verdict(path, content, "poses_unknown", names_of(poses=False)),
        _verdict(path, content, "poses_given", names_of(poses=True)),
    )


@functools.cache
def shipped_verdicts() -> Verdicts:
    """Those that come with the package."""
    return read_verdicts(SHIPPED)


def _plain(verdict: Verdict) -> dict[str, Any]:
    slopes = np.reshape(verdict.weights, (len(SLOPES), -1))
    rows = np.stack([*slopes, verdict.bend, verdict.centre, verdict.spread, verdict.lower, verdict.upper])
    facts = {
        name: {column: _rounded(value) for column, value in zip(COLUMNS, rows[:, index], strict=True)}
        for index, name in enumerate(verdict.names)
    }
    bias = {column: _rounded(value) for column, value in zip(ODDS, verdict.bias, strict=True)}
    return {"bias": bias, "facts": facts}


def _rounded(value: float) -> float:
    return float(f"{float(value):.6g}")


def _verdict(path: str | os.PathLike[str], content: Mapping[str, Any], group: str, names: tuple[str, ...]) -> Verdict:
    """The verdict of one group of the file, its facts in our order."""
    part = content.get(group)
    if not isinstance(part, Mapping) or not isinstance(part.get("facts"), Mapping):
        raise InputError(f"{path}: has no {group} with facts; {REMEDY}")
    unknown = sorted(set(part["facts"]) - set(names))
    if unknown:
        raise InputError(f"{path}: {group} has a fact {unknown[0]!r} that this version does not measure; {REMEDY}")

    def number(mapping: Any, name: str, column: str) -> float:
        value = mapping.get(column) if isinstance(mapping, Mapping) else None
        if not isinstance(value, int | float) or isinstance(value, bool) or not np.isfinite(value):
            raise InputError(f"{path}: {group}, {name}: {column} must be a finite number, not {value!r}; {REMEDY}")
        return float(value)

    rows = np.array([[number(part["facts"].get(name), name, column) for name in names] for column in COLUMNS])
    spread = rows[COLUMNS.index("spread")]
    if not (spread > 0).all():
        raise InputError(f"{path}: {group}, {names[int(spread.argmin())]}: spread must be positive; {REMEDY}")
    bias = np.array([number(part.get("bias"), "bias", column) for column in ODDS])
    slopes, others = rows[: len(SLOPES)], rows[len(SLOPES) :]
    return Verdict(names, slopes.reshape(len(ODDS), -1), bias, *others)
