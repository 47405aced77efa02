"""Files on their way in: what is wrong with a path is said once, with the remedy."""

import os
from pathlib import Path

from gmmjax.errors import InputError


def require_file(path: str | os.PathLike[str]) -> Path:
    """The path of a file that exists, holds something and may be read.

    Args:
        path: the file.

    Returns:
        The same path as a `pathlib.Path`.

    Raises:
        InputError: the path is missing, is no regular file, is empty or may not be read.
    """
    file = Path(path)
    try:
        if file.is_dir():
            raise InputError(f"{file}: is a folder; give the point cloud file inside it")
        with file.open("rb") as stream:
            empty = not stream.read(1)
    except FileNotFoundError:
        raise InputError(f"{file}: no such file; check the path (current folder: {Path.cwd()})") from None
    except PermissionError:
        raise InputError(f"{file}: may not be read; change its permissions (chmod u+r) or copy it") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be opened ({error}); check the path") from error
    if empty:
        raise InputError(f"{file}: is empty (0 bytes); export or copy it again")
    return file


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """All bytes of a file.

    Args:
        path: the file.

    Returns:
        What the file holds, at least one byte.

    Raises:
        InputError: as `require_file`, or the file cannot be read to its end.
    """
    file = require_file(path)
    try:
        return file.read_bytes()
    except (OSError, MemoryError) as error:
        raise InputError(f"{file}: cannot be read ({error!r}); copy it to a local disk and try again") from error
