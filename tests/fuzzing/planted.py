"""Readers with a defect, to see that each kind is found."""

import os
import time
import warnings
from pathlib import Path

import numpy as np

from gmmjax.errors import InputError
from tests.fuzzing.targets import Target

CONTENT = b"1 2 3\n" * 10


def planted_targets() -> dict[str, Target]:
    """By name."""
    readers = (_good, _raises, _dies, _slow, _large, _hangs, _warns, _nameless)
    return {f"planted{reader.__name__}": Target(f"planted{reader.__name__}", _write, reader) for reader in readers}


def _write(folder: Path) -> list[str]:
    (folder / "a.txt").write_bytes(CONTENT)
    return ["a.txt"]


def _good(path: Path) -> None:
    if path.read_bytes()[:3] != CONTENT[:3]:
        raise InputError(f"{path}: does not begin with 1 2")


def _raises(path: Path) -> None:
    path.read_bytes().decode("ascii")


def _dies(path: Path) -> None:
    if len(path.read_bytes()) != len(CONTENT):
        os.abort()


def _slow(path: Path) -> None:
    start = time.process_time()
    while time.process_time() - start < 5.2:
        pass


def _large(path: Path) -> None:
    np.ones(330 << 20)


def _hangs(path: Path) -> None:
    time.sleep(1000)


def _warns(path: Path) -> None:
    warnings.warn("overflow encountered", RuntimeWarning, stacklevel=1)


def _nameless(path: Path) -> None:
    raise InputError("cannot be read")
