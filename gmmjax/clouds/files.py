"""Files on their way in: what is wrong with a path is said once, with the remedy."""

import json
import os
from pathlib import Path
from typing import Any

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


def read_json_record(path: str | os.PathLike[str], schema_version: int, remedy: str) -> dict[str, Any]:
    """A JSON object that gmmjax wrote.

    Args:
        path: the file.
        schema_version: what its "schema_version" must be.
        remedy: what to do where the file is damaged.

    Raises:
        InputError: the file cannot be read, is no JSON, or is of another schema version.
    """
    file = Path(path)
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); name the folder that holds it") from error
    except ValueError as error:
        raise InputError(f"{file}: is not JSON ({error}); {remedy}") from error
    version = content.get("schema_version") if isinstance(content, dict) else None
    if version != schema_version:
        raise InputError(f"{file}: has schema version {version}, this gmmjax reads version {schema_version}")
    return dict(content)
