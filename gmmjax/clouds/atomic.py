"""Writing a file whole or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from gmmjax.errors import InputError


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A binary file that takes the place of `path` when the block ends, and leaves no trace when the block fails.

    The bytes go to a temporary file in the same folder, reach the disk, and the temporary file is renamed. A reader
    sees the old file or the new one, never half of it. A symbolic link stays one: what it points to is replaced.

    Args:
        path: the file to write.

    Yields:
        The open temporary file.

    Raises:
        InputError: the folder is missing or may not be written, or `path` is a folder.
        OSError: from writing, such as a full disk; `path` is then as it was.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file in it")
    # A name of its own length, because the target's name may already be as long as the file system allows.
    temporary = target.with_name(f".gmmjax-{secrets.token_hex(8)}.tmp")
    try:
        file = temporary.open("xb")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); create the folder {target.parent} or choose another one"
        ) from error
    try:
        with file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
