"""Room on a disk, and what is said when it is full."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gmmjax.errors import InputError, one_line


@contextmanager
def disk_errors(folder: Path, needed: int | None = None) -> Iterator[None]:
    """Turn errors of the system into an `InputError` that names the folder.

    Args:
        folder: that is written to.
        needed: bytes that are being written there; None: not known.

    Raises:
        InputError: the disk is full, or fails.
    """
    try:
        yield
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        what = "the disk is full" if full else f"cannot be written or read ({error.strerror or one_line(error)})"
        room = f"; {_gigabytes(needed)} are needed" if needed is not None and full else ""
        raise InputError(
            f"{_of_user(folder)}: {what}{room}; free some room there, or choose a folder on another disk"
        ) from error


def reserve(file: int, size: int) -> None:
    """Reserve room on the disk, so that a disk that is too small is found before the work begins.

    Args:
        file: descriptor of the file.
        size: bytes that it is going to have.

    Raises:
        OSError: there is no room.
    """
    if hasattr(os, "posix_fallocate") and size:
        os.posix_fallocate(file, 0, size)
    else:
        os.ftruncate(file, size)


def _of_user(folder: Path) -> Path:
    """The folder that the user knows: hidden ones in it are gone by the time that he reads of them."""
    while any(part.startswith(".gmmjax-") for part in folder.parts):
        folder = folder.parent
    return folder


def _gigabytes(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e8 else f"{size / 1e6:.1f} MB"
