"""The pairs of a run, from a table or from folders."""

import contextlib
import csv
import glob
import io
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

from gmmjax.batch.scan_pair import BatchPair, check_distinct, check_name
from gmmjax.changes import NAMES, DetectionConfig
from gmmjax.clouds import read_bytes, read_toml
from gmmjax.errors import InputError, one_line, shown
from gmmjax.evaluation import cloud_file, views_file
from gmmjax.pair import Pair

REQUIRED = ("name", "before", "after")
FILES = ("before", "after", "views_before", "views_after")
# A column with a file of settings, and those with a setting each.
CONFIG = "config"
SETTINGS: Mapping[str, Any] = typing.get_type_hints(DetectionConfig)
DELIMITERS: Mapping[str, str] = {".csv": ",", ".tsv": "\t", ".tab": "\t"}
# A message lists at most so many problems and counts the others.
MAX_LISTED = 10


class Entry(NamedTuple):
    """A line of a manifest.

    Attributes:
        place: the file and the line, at the start of messages.
        folder: that paths are relative to.
        values: by column; those that are empty are left out.
    """

    place: str
    folder: Path
    values: Mapping[str, str]

    def file(self, column: str) -> Path | None:
        """The path in a column; None where it has none."""
        return self.folder / self.values[column] if column in self.values else None

    def settings(self, config: DetectionConfig) -> DetectionConfig | None:
        """The settings of the line, in place of those of a config; None where it has none of its own.

        Raises:
            InputError: an unknown setting or a wrong value.
        """
        own = {name: _value(name, text) for name, text in self.values.items() if name in SETTINGS}
        file = self.file(CONFIG)
        if file is None and not own:
            return None
        try:
            given = {} if file is None else _with_verdict_in(file.parent, read_toml(file))
            return DetectionConfig.from_dict({**config.to_dict(), **given, **_with_verdict_in(self.folder, own)})
        except InputError as error:
            raise InputError(f"{self.place}: {error}") from error


@runtime_checkable
class Named(Protocol):
    """A pair or an epoch, made of a line of a manifest."""

    @property
    def name(self) -> str:
        """No other line has it."""

    def files(self) -> dict[str, Path]:
        """The files that it needs, by what they are to it."""


Made = TypeVar("Made", bound=Named)


def read_manifest(path: Path, config: DetectionConfig = DetectionConfig()) -> list[BatchPair]:
    """The pairs of a manifest: CSV or TSV.

    Columns: "name", "before", "after"; where wanted "views_before", "views_after", "config" (a TOML file), and any
    setting of `DetectionConfig` by its name, which wins over the file. Paths are relative to the manifest.

    Args:
        path: of the manifest.
        config: what a pair's own settings are in place of.

    Raises:
        InputError: a manifest that cannot be read, with a missing or an unknown column, a wrong setting, names that are
            there twice or cannot be those of folders, or with files that do not exist, all of which are listed.
    """
    return read_lines(path, REQUIRED, FILES, lambda entry: _pair(entry, config))


def pairs_in_folders(pattern: str) -> list[BatchPair]:
    """A pair for each folder that a pattern matches, which has a file `before` and a file `after` of any format.

    Views are in `before_views` or `views_before`, .json or .npz; the same for after. The pair has the folder's name.

    Raises:
        InputError: no folder matches, or one has no pair of scans, or several files for one scan.
    """
    folders = sorted(Path(found) for found in glob.glob(pattern) if Path(found).is_dir())
    if not folders:
        raise InputError(f"pairs={shown(pattern)} matches no folder; quote it, as in --pairs 'scans/*/'")
    pairs = [_pair_in(folder) for folder in folders]
    check_distinct([pair.name for pair in pairs], f"pairs={shown(pattern)}")
    return pairs


def read_lines(path: Path, required: Sequence[str], files: Sequence[str], make: Callable[[Entry], Made]) -> list[Made]:
    """Read the lines of a manifest, whose names differ and whose files are there.

    Args:
        path: of the manifest.
        required: columns that each line must have.
        files: columns that it may have beside these and the settings.
        make: of a line; it may raise an `InputError`.

    Raises:
        InputError: the file cannot be read, is no table, is empty, or has something wrong, all of which is listed.
    """
    problems, found = _Problems(path), []
    known = {*required, *files, CONFIG, *SETTINGS}
    for number, row in _rows(path):
        place = f"{path}, line {number}"
        with problems.noted(place):
            found.append(make(Entry(place, path.parent, _checked(row, required, known))))
    if not found and not problems.places:
        listed = ", ".join(required)
        raise InputError(f"{path}: has no lines with pairs; write one a line, with the columns {listed}")
    with problems.noted():
        check_distinct([own.name for own in found], str(path))
    with problems.noted():
        _check_files(path, {f"{own.name}: {role}": file for own in found for role, file in own.files().items()})
    problems.tell()
    return found


class _Problems:
    """Errors of a manifest, to be told together: one column may be wrong in each line."""

    def __init__(self, path: Path) -> None:
        self._path = path
        # By what is wrong, where it is.
        self.places: dict[str, list[str]] = {}

    @contextlib.contextmanager
    def noted(self, place: str = "") -> Iterator[None]:
        """Notes an `InputError` of the block."""
        try:
            yield
        except InputError as error:
            self.places.setdefault(str(error).removeprefix(f"{place}: "), []).append(place)

    def tell(self) -> None:
        """Raises what was noted, if anything."""
        texts = [_at(places, text) for text, places in self.places.items()]
        if len(texts) == 1:
            raise InputError(texts[0])
        if texts:
            own = [text.removeprefix(f"{self._path}").lstrip(",: ") for text in texts]
            raise InputError(f"{self._path}: {len(texts)} errors: {_listed(own)}")


def _at(places: Sequence[str], text: str) -> str:
    """A text with where it is so."""
    more = f" (the same in {len(places) - 1} more)" if len(places) > 1 else ""
    return f"{places[0]}: {text}{more}" if places[0] else text


def _listed(texts: Sequence[str]) -> str:
    return "; ".join(texts[:MAX_LISTED]) + (f"; and {len(texts) - MAX_LISTED} more" if len(texts) > MAX_LISTED else "")


def _check_files(path: Path, files: Mapping[str, Path]) -> None:
    absent = [f"{what} {file}" for what, file in files.items() if not file.is_file()]
    if absent:
        raise InputError(f"{path}: {len(absent)} of its {len(files)} files do not exist: {_listed(absent)}")


def _rows(path: Path) -> list[tuple[int, Mapping[Any, Any]]]:
    """The rows of a table, with the numbers of their lines."""
    content, delimiter = read_bytes(path), DELIMITERS.get(path.suffix.lower())
    if delimiter is None:
        raise InputError(f"{path}: is no manifest by its ending; name it {', '.join(DELIMITERS)}, by what it holds")
    try:
        reader = csv.DictReader(io.StringIO(content.decode("utf-8-sig"), newline=""), delimiter=delimiter, strict=True)
        columns = [column.strip() for column in reader.fieldnames or ()]
        reader.fieldnames = columns
        if len(set(columns)) < len(columns):
            raise ValueError("two columns have one name")
        return [(reader.line_num, row) for row in reader]
    except (csv.Error, ValueError) as error:
        remedy = "write it in UTF-8, with a line of column names"
        raise InputError(f"{path}: is no table ({one_line(error)}); {remedy}") from error


def _checked(row: Mapping[Any, Any], required: Sequence[str], known: set[str]) -> dict[str, str]:
    """The values of a row, by column."""
    if None in row:
        raise InputError("has more values than there are columns; quote values with commas")
    values = {column: text.strip() for column, text in row.items() if text is not None and text.strip()}
    if missing := [column for column in required if column not in values]:
        raise InputError(f"has no {' and no '.join(missing)}; every line needs {', '.join(required)}")
    if unknown := [column for column in values if column not in known]:
        listed = ", ".join(shown(column) for column in unknown[:3])
        raise InputError(f"unknown column {listed}; known are {', '.join(sorted(known))}")
    return values


def _pair(entry: Entry, config: DetectionConfig) -> BatchPair:
    check_name(entry.values["name"], f"{entry.place}: name")
    files: dict[str, Any] = {role: entry.file(role) for role in FILES}
    return BatchPair(entry.values["name"], **files, config=entry.settings(config))


def _with_verdict_in(folder: Path, settings: dict[str, Any]) -> dict[str, Any]:
    """Settings whose verdict, a file, is relative to a folder."""
    verdict = settings.get("verdict")
    return {**settings, "verdict": str(folder / verdict)} if isinstance(verdict, str) else settings


def _value(name: str, text: str) -> Any:
    """A setting from its text; `DetectionConfig` refuses what cannot be read."""
    kinds = {SETTINGS[name], *typing.get_args(SETTINGS[name])}
    if bool in kinds:
        return {"true": True, "false": False}.get(text.lower(), text)
    with contextlib.suppress(ValueError):
        if name == "crop":
            return tuple(map(float, text.split()))
        if int in kinds:
            return int(text)
        if float in kinds:
            return float(text)
    return text


def _pair_in(folder: Path) -> BatchPair:
    check_name(folder.name, f"{folder}: name")
    clouds = Pair(*NAMES).map(lambda side: cloud_file(folder, side))
    views = Pair(*NAMES).map(lambda side: views_file(folder, side))
    return BatchPair(folder.name, clouds.before, clouds.after, views.before, views.after)
