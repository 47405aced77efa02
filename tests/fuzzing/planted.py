"""Readers with a defect, to see that each kind is found."""

import os
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gmmjax.errors import InputError
from tests.fuzzing.targets import Target

CONTENT = b"".join(b"%d 2 3\n" % number for number in range(20))


def planted_targets() -> dict[str, Target]:
    """By name."""
    readers = (_raises, _dies, _slow, _large, _hangs, _warns, _nameless)
    targets = {f"planted{reader.__name__}": Target("planted", _write, _only_mutants(reader)) for reader in readers}
    return targets | {"planted_good": Target("planted", _write, _good)}


def _only_mutants(read: Callable[[Path], None]) -> Callable[[Path], None]:
    def read_mutant(path: Path) -> None:
        if path.read_bytes() != CONTENT:
            read(path)

    return read_mutant


def _write(folder: Path) -> list[str]:
    (folder / "a.txt").write_bytes(CONTENT)
    return ["a.txt"]


def _good(path: Path) -> None:
    if path.read_bytes()[:20] != CONTENT[:20]:
        raise InputError(f"{path}: begins with something else")


def _raises(path: Path) -> None:
    raise KeyError(path.name)


def _dies(path: Path) -> None:
    os.abort()


def _slow(path: Path) -> None:
    start = time.process_time()
    while time.process_time() - start < 0.3:
        pass


def _large(path: Path) -> None:
    np.ones(40 << 20)


def _hangs(path: Path) -> None:
    time.sleep(1000)


def _warns(path: Path) -> None:
    warnings.warn("overflow encountered", RuntimeWarning, stacklevel=1)


def _nameless(path: Path) -> None:
    raise InputError("cannot be read")
