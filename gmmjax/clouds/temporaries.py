"""Temporary files and folders, beside what is written, that are locked while their process lives.

The system releases a lock when its process ends, however it ends. So what lies there without a lock was left by a dead
process, and is cleared by the next one that writes there: no process number is kept, which another process may have by
then. The names hold a mark of the host, because not every network file system passes locks on to other hosts.
"""

import functools
import hashlib
import os
import platform
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TypeVar

try:
    import fcntl
except ImportError:  # Windows: nothing is locked there, and nothing cleared.
    fcntl = None  # type: ignore[assignment]

PREFIX = ".gmmjax-"
# Names that are tried; only another process that clears the folder at that very moment can take one away.
ATTEMPTS = 5
# A temporary folder with this file was replacing a previous result, and holds parts of it: see `clear_folders`.
JOURNAL = ".moves.json"

_Made = TypeVar("_Made")


@contextmanager
def temporary_folder(parent: Path) -> Iterator[Path]:
    """A new hidden folder, removed with what is in it when the block ends.

    Args:
        parent: where it is made.

    Raises:
        OSError: it cannot be made.
    """

    def make() -> tuple[Path, int | None]:
        folder = parent / _name()
        folder.mkdir()
        try:
            return folder, _lock(folder)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    folder, descriptor = _held(make)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if descriptor is not None:
            os.close(descriptor)


@contextmanager
def temporary_file(folder: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """A new hidden file, open for writing; removed when the block ends, unless it was renamed.

    Raises:
        OSError: it cannot be made.
    """
    _clear_files(folder)

    def make() -> tuple[tuple[Path, BinaryIO], int | None]:
        path = folder / f"{_name()}.tmp"
        file = path.open("xb")
        try:
            return (path, file), _lock(path)
        except BaseException:
            file.close()
            path.unlink(missing_ok=True)
            raise

    (path, file), descriptor = _held(make)
    try:
        with file:
            yield path, file
    finally:
        path.unlink(missing_ok=True)
        if descriptor is not None:
            os.close(descriptor)


@contextmanager
def locked_file(folder: Path, name: str, *, shared: bool = False) -> Iterator[None]:
    """Holds a lock in a folder while the block runs; its hidden file stays. Nothing where a file system has no locks.

    Args:
        folder: that is there.
        name: of the lock.
        shared: with others that hold it shared; else alone.

    Raises:
        BlockingIOError: another process holds it.
        OSError: its file cannot be made.
    """
    if fcntl is None:
        yield
        return
    descriptor = os.open(folder / f"{PREFIX}{name}.lock", os.O_RDWR | os.O_CREAT, 0o666)
    try:
        _try_lock(descriptor, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def clear_folders(parent: Path, recover: Callable[[Path], None] | None = None) -> None:
    """Removes the temporary folders in a folder that dead processes of this host left there.

    Args:
        parent: is left alone where it is missing or cannot be read.
        recover: called on each before it is removed; one for which it raises an `OSError` stays. None: those with a
            `JOURNAL` stay.
    """
    for folder in _temporaries(parent, suffix=""):
        with _if_left_behind(folder) as left_behind, suppress(OSError):
            if left_behind and folder.is_dir() and not (recover is None and (folder / JOURNAL).exists()):
                if recover is not None:
                    recover(folder)
                shutil.rmtree(folder, ignore_errors=True)


@functools.lru_cache(maxsize=64)
def _clear_files(folder: Path) -> None:
    """Removes the temporary files that dead processes left; once, because a folder may get very many files."""
    for path in _temporaries(folder, suffix=".tmp"):
        with _if_left_behind(path) as left_behind, suppress(OSError):
            if left_behind and path.is_file():
                path.unlink()


def _temporaries(folder: Path, suffix: str) -> list[Path]:
    pattern = re.compile(rf"{re.escape(PREFIX)}{_host()}-[0-9a-f]{{16}}{re.escape(suffix)}")
    try:
        return sorted(path for path in folder.iterdir() if pattern.fullmatch(path.name) and not path.is_symlink())
    except OSError:
        return []


@contextmanager
def _if_left_behind(path: Path) -> Iterator[bool]:
    """Whether no live process holds the path's lock; while the block runs none can take it."""
    try:
        descriptor = _lock(path)
    except OSError:
        yield False
        return
    try:
        yield descriptor is not None
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _held(make: Callable[[], tuple[_Made, int | None]]) -> tuple[_Made, int | None]:
    """What `make` makes and locks; made anew where another process, which clears, came in between."""
    for _ in range(ATTEMPTS - 1):
        with suppress(BlockingIOError, FileNotFoundError):
            return make()
    return make()


def _lock(path: Path) -> int | None:
    """The open descriptor that holds the path's lock; None where the system or the file system has no locks.

    Raises:
        BlockingIOError: another process holds it.
        FileNotFoundError: the path is gone, or another file has its name by now.
        OSError: it cannot be opened.
    """
    if fcntl is None:
        return None
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        if not _try_lock(descriptor):
            os.close(descriptor)
            return None
        if not os.path.samestat(os.lstat(path), os.fstat(descriptor)):
            raise FileNotFoundError(path)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _try_lock(descriptor: int, kind: int | None = None) -> bool:
    """Whether the file system has locks; another process's lock is a `BlockingIOError`."""
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_EX if kind is None else kind) | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        return False
    return True


def _name() -> str:
    return f"{PREFIX}{_host()}-{secrets.token_hex(8)}"


@functools.cache
def _host() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]
