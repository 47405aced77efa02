"""The content of a file by a hash, with its size and time, which save reading it again."""

import dataclasses
import hashlib
import os
from pathlib import Path

import numpy as np

from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.errors import InputError


@dataclasses.dataclass(frozen=True)
class Fingerprint:
    """A file at one time; in a record its fields by name.

    Attributes:
        size: bytes.
        modified: when it was written, nanoseconds since 1970.
        sha256: hash of its content, 64 hexadecimal digits.
    """

    size: int
    modified: int
    sha256: str

    @classmethod
    def of(cls, path: Path) -> "Fingerprint":
        """The fingerprint of a file.

        Raises:
            InputError: the file cannot be read.
        """
        try:
            with path.open("rb") as file:
                status = os.fstat(file.fileno())
                return cls(status.st_size, status.st_mtime_ns, hashlib.file_digest(file, "sha256").hexdigest())
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the path") from error

    def matches(self, path: Path) -> bool:
        """True where a file has this content; it is read only where its time is another one, and the size the same."""
        try:
            status = path.stat()
            if status.st_size != self.size:
                return False
            return status.st_mtime_ns == self.modified or Fingerprint.of(path).sha256 == self.sha256
        except (OSError, InputError):
            return False


def fingerprint_of_memory(content: PointCloud | SensorViews) -> Fingerprint:
    """The fingerprint of what was given in memory, of all that a result depends on; its time is 0."""
    stated: tuple[object, ...] = ()
    if isinstance(content, SensorViews):
        arrays = {"poses": content.poses, "sees": np.array([*content.field_of_view, content.max_range])}
    else:
        colors = np.empty(0, np.uint8) if content.colors is None else content.colors
        arrays = {"points": content.points, "rows": content.rows, "colors": colors}
        arrays |= {f"field {name}": values for name, values in content.fields.items()}
        stated = content.unit, content.crs, content.file, *content.files
    digest = hashlib.sha256(repr(stated).encode())
    for name, array in arrays.items():
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return Fingerprint(sum(array.nbytes for array in arrays.values()), 0, digest.hexdigest())
