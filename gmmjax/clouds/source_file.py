"""The file that a cloud was read from, as it was then."""

from dataclasses import dataclass
from pathlib import Path

from gmmjax.errors import InputError


@dataclass(frozen=True)
class SourceFile:
    """A file that is read again while a result is written, so that no second copy of it is held in memory.

    Attributes:
        path: of the file, absolute.
        size: bytes.
        modified: when it was written, nanoseconds since 1970.
    """

    path: Path
    size: int
    modified: int

    @classmethod
    def of(cls, path: Path) -> "SourceFile":
        """Look at the file as it is now; raises an `InputError` where it is not there any more."""
        try:
            status = path.stat()
        except OSError as error:
            raise InputError(f"{path}: cannot be opened ({error.strerror or error}); check the path") from error
        return cls(path.absolute(), status.st_size, status.st_mtime_ns)

    @property
    def ending(self) -> str:
        """The end of its name in lower case, such as ".las"."""
        return self.path.suffix.lower()

    def require_unchanged(self) -> None:
        """Check that the file was not changed or removed since, and raise an `InputError` otherwise."""
        if SourceFile.of(self.path) != self:
            raise InputError(f"{self.path}: was changed since it was read; run the detection again")


@dataclass(frozen=True)
class FileRows:
    """The part of one file in a cloud of several.

    Attributes:
        file: that was read.
        rows: first row of the file among those of the cloud, and the one after its last.
        fields: names of its own fields, with their types as NumPy writes them.
        colored: whether it has colours.
    """

    file: SourceFile
    rows: tuple[int, int]
    fields: tuple[tuple[str, str], ...]
    colored: bool
