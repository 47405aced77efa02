"""The journal of a run: the results of finished units on disk, from which an interrupted run resumes."""

import json
import os
import zlib
from pathlib import Path
from typing import Any

from gmmjax.clouds import parse_json, read_bytes
from gmmjax.errors import InputError
from gmmjax.thesis.chapter4.records import Unit


class Journal:
    """A file of JSON lines, each with the key of a unit, its result, and a checksum of both.

    A line is flushed to disk before the next unit begins. Only a line that was interrupted while it was written is
    lost.
    """

    def __init__(self, path: Path) -> None:
        """Reads the file.

        Args:
            path: of the file, which need not exist.

        Raises:
            InputError: a line before the last one is damaged, or the file cannot be read.
        """
        self._path = path
        self._results: dict[str, dict[str, Any]] = {}
        if not path.exists():
            return
        if path.is_file() and not path.stat().st_size:
            return
        content = read_bytes(path)
        *lines, unfinished = content.split(b"\n")
        for number, line in enumerate(lines, start=1):
            self._read(line, number)
        if unfinished:
            os.truncate(path, len(content) - len(unfinished))

    def __len__(self) -> int:
        return len(self._results)

    def __contains__(self, unit: Unit) -> bool:
        return unit.key in self._results

    def result(self, unit: Unit) -> dict[str, Any]:
        """The result of a unit that is in the journal."""
        return self._results[unit.key]

    def add(self, unit: Unit, result: dict[str, Any]) -> None:
        """Appends the result of a unit.

        Raises:
            InputError: the file cannot be written.
        """
        entry = {"key": unit.key, "result": result, "checksum": _checksum(unit.key, result)}
        line = json.dumps(entry, allow_nan=False) + "\n"
        try:
            with self._path.open("ab") as file:
                file.write(line.encode())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(
                f"{self._path}: cannot be written ({error.strerror}); free some space, and the same command goes on"
            ) from error
        # The same as after reading: tuples become lists.
        self._results[unit.key] = json.loads(line)["result"]

    def _read(self, line: bytes, number: int) -> None:
        try:
            entry = parse_json(line)
            key, result = entry["key"], entry["result"]
            if entry["checksum"] != _checksum(key, result):
                raise ValueError("another checksum")
            self._results[key] = result
        except (ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{self._path}: line {number} is damaged; take it out, or begin anew with --overwrite"
            ) from error


def _checksum(key: str, result: dict[str, Any]) -> int:
    """CRC-32 of the JSON text, so that it is the same before writing and after reading."""
    return zlib.crc32(json.dumps([key, result]).encode())
