"""Writing a file whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO

from gmmjax.clouds.temporaries import temporary_file
from gmmjax.errors import InputError

_together: ContextVar[bool] = ContextVar("files reach the disk together", default=False)


@contextmanager
def synced_together() -> Iterator[None]:
    """While the block runs `atomic_write` leaves it to whoever runs it that files reach the disk.

    To wait for each of a dozen files takes longer than to compute what is in them, where a disk is slow.
    """
    token = _together.set(True)
    try:
        yield
    finally:
        _together.reset(token)


@contextmanager
def atomic_write(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A binary file that takes the place of `path` when the block ends, and leaves no trace when the block fails.

    The bytes go to a temporary file in the same folder, reach the disk, and the temporary file is renamed. A reader
    sees the old file or the new one, never half of it. A symbolic link stays one: what it points to is replaced.
    Temporary files of processes that were killed are removed.

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
    with ExitStack() as stack:
        try:
            temporary, file = stack.enter_context(temporary_file(target.parent))
        except OSError as error:
            raise InputError(
                f"{path}: cannot be written ({error.strerror}); create the folder {target.parent} or choose another one"
            ) from error
        yield file
        file.flush()
        if not _together.get():
            os.fsync(file.fileno())
        file.close()
        os.replace(temporary, target)
