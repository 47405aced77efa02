"""Checks of files before they are read, and small files of JSON and TOML."""

import json
import math
import os
import stat
import tomllib
from pathlib import Path
from typing import Any

from gmmjax.errors import LARGEST_INTEGER, InputError, one_line

# Bytes of the largest settings, intrinsics and records that are parsed, all of which have kilobytes: a parser needs
# some twenty times the memory, and TOML's minutes for some megabytes. Without a limit a wrong file fills the memory.
MAX_JSON = 1 << 26
MAX_SETTINGS = 1 << 18
# Dots in a line of TOML, such as in six decimal numbers: memory grows with the square of a dotted key's length.
MAX_DOTS = 200

KINDS = {
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def require_file(path: str | os.PathLike[str], most: int | None = None) -> Path:
    """Check that a path is of a regular file that exists, holds something and may be read, or a link to one.

    Every reader asks this before it opens a file: a pipe or a device may never end, or wait for ever.

    Args:
        path: the file.
        most: bytes that it may have; None is any number.

    Returns:
        The same path as a `pathlib.Path`.

    Raises:
        InputError: the path is missing, is no regular file, is empty, too large or may not be read.
    """
    file = Path(path)
    try:
        status = file.stat()
        if stat.S_ISDIR(status.st_mode):
            raise InputError(f"{file}: is a folder; give the file inside it")
        if not stat.S_ISREG(status.st_mode):
            kind = KINDS.get(stat.S_IFMT(status.st_mode), "no regular file")
            raise InputError(f"{file}: is {kind}; write what comes from it to a file, and give that")
        with file.open("rb") as stream:
            empty = not stream.read(1)
    except FileNotFoundError:
        raise InputError(f"{file}: no such file; check the path (current folder: {Path.cwd()})") from None
    except PermissionError:
        raise InputError(f"{file}: may not be read; change its permissions (chmod u+r) or copy it") from None
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be opened ({one_line(error)}); check the path") from error
    if empty:
        raise InputError(f"{file}: is empty (0 bytes); export or copy it again")
    if most is not None and status.st_size > most:
        raise InputError(f"{file}: has {status.st_size} bytes, and may have {most}; check that it is the right file")
    return file


def read_bytes(path: str | os.PathLike[str], most: int | None = None) -> bytes:
    """Read all bytes of a file, of which it may have at most so many.

    Raises:
        InputError: as `require_file`, or the file cannot be read to its end.
    """
    file = require_file(path, most)
    try:
        return file.read_bytes()
    except (OSError, MemoryError) as error:
        raise InputError(f"{file}: cannot be read ({error!r}); copy it to a local disk and try again") from error


def parse_json(text: bytes) -> Any:
    """Parse JSON in UTF-8, whose numbers must be finite, and whole ones fit 64 bits.

    Raises:
        ValueError: no JSON, nested too deeply, or with NaN, infinity or a number that is too large.
    """
    try:
        return json.loads(
            text.decode("utf-8-sig"), parse_constant=_no_constant, parse_int=_whole_number, parse_float=_finite_number
        )
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_json(path: str | os.PathLike[str], remedy: str) -> Any:
    """Read a JSON file as `parse_json` does; raises an `InputError` with the remedy where it is none."""
    content = read_bytes(path, MAX_JSON)
    try:
        return parse_json(content)
    except ValueError as error:
        raise InputError(f"{os.fspath(path)}: is not JSON ({one_line(error)}); {remedy}") from error


def read_json_record(path: str | os.PathLike[str], schema_version: int, remedy: str) -> dict[str, Any]:
    """Read a JSON object that gmmjax wrote.

    Args:
        path: the file.
        schema_version: what its "schema_version" must be.
        remedy: what to do where the file is damaged.

    Raises:
        InputError: the file cannot be read, is no JSON, or is of another schema version.
    """
    content = read_json(path, remedy)
    version = content.get("schema_version") if isinstance(content, dict) else None
    if version != schema_version:
        newer = isinstance(version, int) and not isinstance(version, bool) and version > schema_version
        why = "it was written by a newer gmmjax: update this one (pip install --upgrade gmmjax), or " if newer else ""
        raise InputError(
            f"{os.fspath(path)}: has schema version {str(version)[:20]}, this gmmjax reads version {schema_version}; "
            f"{why}{remedy}"
        )
    return dict(content)


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the settings in a TOML file; whole numbers must fit 64 bits, as TOML has it.

    Raises:
        InputError: the file cannot be read, or is no TOML.
    """
    content = read_bytes(path, MAX_SETTINGS)
    lines = (line for line in content.split(b"\n") if not line.lstrip().startswith(b"#"))
    try:
        if any(line.count(b".") > MAX_DOTS for line in lines):
            raise ValueError(f"a line has more than {MAX_DOTS} dots")
        settings = tomllib.loads(content.decode("utf-8"))
        _check_whole_numbers(settings)
    except RecursionError:
        raise InputError(f"{os.fspath(path)}: is nested too deeply; write one setting a line") from None
    # tomllib lets ValueErrors of int() and datetime() through.
    except ValueError as error:
        raise InputError(
            f"{os.fspath(path)}: is not TOML ({one_line(error)}); write one setting a line, such as restarts = 8"
        ) from error
    return settings


def _no_constant(name: str) -> Any:
    raise ValueError(f"{name} is no number of JSON")


def _whole_number(digits: str) -> int:
    # int() takes time that grows with the square of the length.
    if len(digits) > 20 or abs(number := int(digits)) > LARGEST_INTEGER:
        raise ValueError(f"the number {digits[:20]}... of {len(digits)} digits is too large")
    return number


def _finite_number(text: str) -> float:
    if math.isinf(number := float(text)):
        raise ValueError(f"the number {text[:40]} is too large")
    return number


def _check_whole_numbers(settings: dict[str, Any]) -> None:
    waiting: list[Any] = [settings]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting.extend(value.values())
        elif isinstance(value, list):
            waiting.extend(value)
        elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            raise ValueError(f"a whole number of {value.bit_length()} bits is too large")
