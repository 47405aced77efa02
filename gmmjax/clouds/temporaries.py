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
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from gmmjax.errors import InputError

try:
    import fcntl
except ImportError:  # Windows: nothing is locked there, and nothing cleared.
    fcntl = None  # type: ignore[assignment]

PREFIX = ".gmmjax-"
# Names that are tried; only another process that clears the folder at that very moment can take one away.
ATTEMPTS = 5
# A temporary folder with this file was replacing a previous result, and holds parts of it: see `clear_folders`.
JOURNAL = ".moves.json"


@contextmanager
def temporary_folder(parent: Path) -> Iterator[Path]:
    """A new hidden folder, removed with what is in it when the block ends.

    Args:
        parent: where it is made.

    Raises:
        OSError: it cannot be made.
    """
    with _claimed(parent, "", Path.mkdir) as folder:
        yield folder


@contextmanager
def working_folder(parent: Path) -> Iterator[Path]:
    """A `temporary_folder` whose parent a user named; those that dead processes left there are removed before.

    Args:
        parent: where it is made.

    Raises:
        InputError: it cannot be made.
    """
    clear_folders(parent)
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(temporary_folder(parent))
        except OSError as error:
            raise InputError(
                f"{parent}: cannot be written ({error.strerror}); create the folder or choose another one"
            ) from error
        yield folder


@contextmanager
def temporary_file(folder: Path) -> Iterator[tuple[Path, BinaryIO]]:
    """A new hidden file, open for writing; removed when the block ends, unless it was renamed.

    Raises:
        OSError: it cannot be made.
    """
    _clear_files(folder)
    with _claimed(folder, ".tmp", functools.partial(Path.touch, exist_ok=False)) as path, path.open("wb") as file:
        yield path, file


@contextmanager
def locked_file(folder: Path, name: str, *, shared: bool = False) -> Iterator[None]:
    """Hold a lock in a folder while the block runs; its hidden file stays. Nothing where a file system has no locks.

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
    """Remove the temporary folders in a folder that dead processes of this host left there.

    Args:
        parent: is left alone where it is missing or cannot be read.
        recover: called on each before it is removed; one for which it raises an `OSError` stays. None: those with a
            `JOURNAL` stay.
    """
    for folder in _left_behind(parent, ""):
        if folder.is_dir() and not (recover is None and (folder / JOURNAL).exists()):
            with suppress(OSError):
                if recover is not None:
                    recover(folder)
                shutil.rmtree(folder, ignore_errors=True)


@functools.lru_cache(maxsize=64)
def _clear_files(folder: Path) -> None:
    """Remove the temporary files that dead processes left; once, because a folder may get very many files."""
    for path in _left_behind(folder, ".tmp"):
        if path.is_file():
            with suppress(OSError):
                path.unlink()


def _left_behind(folder: Path, suffix: str) -> Iterator[Path]:
    """The temporaries in a folder whose lock no live process holds; while one is looked at none can take it."""
    for path in _temporaries(folder, suffix):
        try:
            descriptor = _lock(path)
        except OSError:
            continue
        if descriptor is not None:
            try:
                yield path
            finally:
                os.close(descriptor)


def _temporaries(folder: Path, suffix: str) -> list[Path]:
    pattern = re.compile(rf"{re.escape(PREFIX)}{_host()}-[0-9a-f]{{16}}{re.escape(suffix)}")
    try:
        return sorted(path for path in folder.iterdir() if pattern.fullmatch(path.name) and not path.is_symlink())
    except OSError:
        return []


@contextmanager
def _claimed(parent: Path, suffix: str, make: Callable[[Path], None]) -> Iterator[Path]:
    """A new path that is made and locked, and removed in the end."""
    path, descriptor = _made(parent, suffix, make)
    try:
        yield path
    finally:
        _remove(path)
        if descriptor is not None:
            os.close(descriptor)


def _made(parent: Path, suffix: str, make: Callable[[Path], None]) -> tuple[Path, int | None]:
    """A path that is made, and the descriptor of its lock; anew where another process, which clears, came between."""
    for attempt in range(ATTEMPTS):
        path = parent / f"{_name()}{suffix}"
        make(path)
        try:
            return path, _lock(path)
        except BaseException as error:
            _remove(path)
            if attempt == ATTEMPTS - 1 or not isinstance(error, BlockingIOError | FileNotFoundError):
                raise
    raise AssertionError("the last attempt returns or raises")


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


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
    """True where the file system has locks; another process's lock is a `BlockingIOError`."""
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
