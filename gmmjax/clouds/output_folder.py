"""Folders that a command writes whole or not at all."""

import dataclasses
import json
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from gmmjax.clouds.atomic import synced_together
from gmmjax.clouds.files import read_json
from gmmjax.clouds.temporaries import JOURNAL, PREFIX, clear_folders, temporary_folder
from gmmjax.errors import InputError

# In the staging folder: what is being replaced.
PREVIOUS = "previous"


@dataclasses.dataclass(frozen=True)
class FolderKind:
    """The contents of the folders of one kind.

    Attributes:
        name: what messages call such a folder.
        marker: the JSON file by which the folder is known; it is the last to be put in place and the first to go.
        key: a key that the marker has, beside "schema_version".
        others: the other files that may be there.
        tree: whether it holds folders and files of any name; whatever is there is then known by the marker alone.
        owned: whether it lies in a folder of ours, so that what is there without a marker is what is left of one.
        folders: folders that may be there, with files of any name.
    """

    name: str
    marker: str
    key: str
    others: tuple[str, ...]
    tree: bool = False
    owned: bool = False
    folders: tuple[str, ...] = ()

    def is_held_by(self, folder: Path) -> bool:
        """True where the folder's marker is one of this kind, of any schema version."""
        try:
            content = read_json(folder / self.marker, "choose another output folder")
        except InputError:
            return False
        return isinstance(content, dict) and "schema_version" in content and self.key in content


def check_output_folder(folder: str | os.PathLike[str], kind: FolderKind, *, overwrite: bool = False) -> None:
    """Check that `output_folder` could write there, before a long computation.

    Changes nothing, but clears what processes that were killed left there. Where one was killed while it replaced a
    previous result, that is put back.

    Args:
        folder: may be missing, with any of its parents; may be empty.
        kind: what is to be written.
        overwrite: whether a folder of the same kind may be replaced.

    Raises:
        InputError: the folder is a file, holds something else, holds a result and not `overwrite`, or cannot be
            written.
    """
    target = Path(os.path.realpath(folder))
    for place in (target.parent, target):
        clear_folders(place, recover=_put_back)
    try:
        if _exists(folder):
            _check_contents(Path(folder), kind, overwrite)
        _check_writable(Path(folder))
    except OSError as error:
        raise _cannot_write(folder, error) from error


@contextmanager
def output_folder(folder: str | os.PathLike[str], kind: FolderKind, *, overwrite: bool = False) -> Iterator[Path]:
    """A hidden staging folder that takes the place of `folder` when the block ends, and is removed when it fails.

    A folder that is not there yet appears whole, by one renaming. Into one that is there (empty, or with a previous
    result) the files are moved one by one, the marker last; when that fails the previous files are put back.

    Args:
        folder: where the files are to be; parents are made where needed.
        kind: what is written.
        overwrite: whether a folder of the same kind may be replaced.

    Yields:
        The staging folder, on the same file system.

    Raises:
        InputError: as `check_output_folder`, or writing failed, as on a full disk; `folder` is then as it was.
    """
    check_output_folder(folder, kind, overwrite=overwrite)
    target = Path(os.path.realpath(folder))
    home = target if target.is_dir() else target.parent
    new_parents = [parent for parent in (home, *home.parents) if not parent.exists()]
    try:
        home.mkdir(parents=True, exist_ok=True)
        with temporary_folder(home) as staging:
            with synced_together():
                yield staging
            _sync_all(staging)
            _publish(staging, target, kind)
    except BaseException as error:
        for parent in new_parents:
            with suppress(OSError):
                parent.rmdir()
        # A writer's own message would name the staging folder.
        cause = error if isinstance(error, OSError) else error.__cause__
        if isinstance(cause, OSError):
            raise _cannot_write(folder, cause) from error
        raise


def _check_contents(folder: Path, kind: FolderKind, overwrite: bool) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; choose another name for the output folder")
    if not folder.exists():
        raise InputError(f"{folder}: is a link to something that is not there; choose another output folder")
    entries = [entry for entry in folder.iterdir() if not entry.name.startswith(PREFIX)]
    files, folders = {kind.marker, *kind.others}, set(kind.folders)
    known = [e for e in entries if (e.name in files and e.is_file()) or (e.name in folders and e.is_dir())]
    foreign = [] if kind.tree else sorted(e.name for e in entries if e not in known)
    if entries and not foreign and not kind.owned and not kind.is_held_by(folder):
        foreign = sorted(entry.name for entry in entries)
    if foreign:
        listed = ", ".join(foreign[:3]) + (", ..." if len(foreign) > 3 else "")
        raise InputError(f"{folder}: holds something else ({listed}); choose a new or an empty output folder")
    if entries and not overwrite:
        raise InputError(
            f"{folder}: holds a previous {kind.name}; --overwrite replaces it (overwrite=True in Python), or choose "
            "another folder"
        )


def _exists(path: str | os.PathLike[str]) -> bool:
    """True where something has that name; a path that the system refuses, such as too long a one, is an error."""
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return True


def _check_writable(folder: Path) -> None:
    existing = next(path for path in (folder.absolute(), *folder.absolute().parents) if _exists(path))
    if not existing.is_dir():
        raise InputError(f"{folder}: cannot be made, because {existing} is no folder; choose another output folder")
    with temporary_folder(existing):
        pass


def _cannot_write(folder: str | os.PathLike[str], error: OSError) -> InputError:
    return InputError(
        f"{os.fspath(folder)}: cannot be written ({error.strerror or error}); nothing was left there. "
        "Free some space or choose another output folder"
    )


def _publish(staging: Path, target: Path, kind: FolderKind) -> None:
    if target.exists():
        _move_files(staging, target, kind)
    else:
        staging.rename(target)
    # All is in place: what is left to do is to hurry the new names to the disk.
    with suppress(OSError):
        _sync(target.parent)


def _move_files(staging: Path, target: Path, kind: FolderKind) -> None:
    retired = staging / PREVIOUS
    new = sorted((path for path in staging.iterdir()), key=lambda path: path.name == kind.marker)
    retired.mkdir()
    names = (kind.marker, *(sorted(os.listdir(target)) if kind.tree else (*kind.others, *kind.folders)))
    old = [target / name for name in dict.fromkeys(names) if _is_content(target / name)]
    moves = [(path, retired / path.name) for path in old] + [(path, target / path.name) for path in new]
    _write_journal(staging, kind.marker, [path.name for path in old], [path.name for path in new])
    done: list[tuple[Path, Path]] = []
    try:
        for source, destination in moves:
            source.replace(destination)
            done.append((source, destination))
        _sync(target)
    except BaseException:
        for source, destination in reversed(done):
            destination.replace(source)
        raise


def _write_journal(staging: Path, marker: str, old: list[str], new: list[str]) -> None:
    """Note what is about to be moved, on the disk before the first file moves."""
    with (staging / JOURNAL).open("w", encoding="utf-8") as file:
        json.dump({"marker": marker, "old": old, "new": new}, file)
        file.flush()
        os.fsync(file.fileno())
    _sync(staging)


def _put_back(staging: Path) -> None:
    """Put the previous result back, if the process died after it had begun to move files into the folder of `staging`.

    Raises:
        OSError: a file could not be moved.
    """
    target, retired = staging.parent, staging / PREVIOUS
    try:
        moves = json.loads((staging / JOURNAL).read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        # It died before the first move.
        return
    if not (staging / moves["marker"]).exists():
        # It died after the last one: the new result is whole.
        return
    for name in moves["new"]:
        if not (staging / name).exists() and (target / name).exists():
            (target / name).replace(staging / name)
    # The marker was the first to go and is the last to come back.
    for name in reversed(moves["old"]):
        if (retired / name).exists():
            (retired / name).replace(target / name)
    _sync(target)


def _is_content(path: Path) -> bool:
    return path.exists() and not path.name.startswith(PREFIX)


def _sync_all(folder: Path) -> None:
    """Make all files reach the disk, and the entries of all folders: together, since each waits for the disk."""
    paths = [path for path in folder.rglob("*") if path.is_file() or (path.is_dir() and os.name != "nt")]
    with ThreadPoolExecutor(max(1, min(8, len(paths)))) as pool:
        list(pool.map(_sync_path, paths))
    _sync(folder)


def _sync_path(path: Path) -> None:
    # Windows syncs only what is open for writing.
    descriptor = os.open(path, os.O_RDONLY if os.name != "nt" else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _sync(folder: Path) -> None:
    """Make the folder's entries reach the disk, where the system lets a folder be opened."""
    if os.name == "nt":
        return
    _sync_path(folder)
