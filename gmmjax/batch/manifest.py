"""The pairs of a run, from a table or from folders."""

import contextlib
import csv
import dataclasses
import glob
import io
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from gmmjax.batch.scan_pair import BatchPair, check_distinct, check_name
from gmmjax.changes import NAMES, DetectionConfig
from gmmjax.clouds import READERS, parse_json, read_bytes, read_toml
from gmmjax.errors import InputError, one_line, shown

REQUIRED = ("name", "before", "after")
FILES = ("before", "after", "views_before", "views_after")
# A column or key with a file of settings.
CONFIG = "config"
DELIMITERS: Mapping[str, str] = {".csv": ",", ".tsv": "\t", ".tab": "\t"}
JSON_LINES = (".jsonl", ".ndjson")
# Settings that a line may have.
SETTING_NAMES = tuple(field.name for field in dataclasses.fields(DetectionConfig))
# The views beside the clouds in a folder, as `extract` writes them and as the options are called.
VIEWS = ("{side}_views", "views_{side}")


# Of what is wrong, at most, that a message lists; the others are counted.
MOST = 10
Made = TypeVar("Made")


class Entry(NamedTuple):
    """A line of a manifest.

    Attributes:
        place: the file and the line, at the start of messages.
        values: by column; those that are empty are left out.
    """

    place: str
    values: Mapping[str, Any]


def read_manifest(path: Path, config: DetectionConfig = DetectionConfig()) -> list[BatchPair]:
    """The pairs of a manifest: CSV, TSV or JSON lines.

    Columns: "name", "before", "after"; where wanted "views_before", "views_after", "config" (a TOML file), and any
    setting of `DetectionConfig` by its name, which wins over the file. Paths are relative to the manifest.

    Args:
        path: of the manifest.
        config: what a pair's own settings are in place of.

    Raises:
        InputError: a manifest that cannot be read, with a missing or an unknown column, a wrong setting, names that are
            there twice or cannot be those of folders, or with files that do not exist, all of which are listed.
    """
    problems, known = Problems(path), {*REQUIRED, *FILES, CONFIG, *SETTING_NAMES}
    pairs = problems.made_of_lines(REQUIRED, known, lambda entry: _pair(entry, path.parent, config))
    with problems.noted():
        check_distinct([pair.name for pair in pairs], str(path))
    with problems.noted():
        check_files(path, {f"{pair.name}: {role}": file for pair in pairs for role, file in pair.files().items()})
    problems.tell()
    return pairs


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


class Problems:
    """What is wrong with a manifest, to be told together."""

    def __init__(self, path: Path) -> None:
        """Nothing is wrong yet."""
        self._path = path
        # By what is wrong, where it is: one column may be wrong in each line.
        self._places: dict[str, list[str]] = {}

    def made_of_lines(self, required: Sequence[str], known: Set[str], make: Callable[[Entry], Made]) -> list[Made]:
        """What is made of each line that nothing is wrong with.

        Args:
            required: columns that each line must have.
            known: columns that a line may have.
            make: of a line; it may raise an `InputError`.

        Raises:
            InputError: the file cannot be read, is no table and no JSON lines, or is empty.
        """
        json_lines = self._path.suffix.lower() in JSON_LINES
        content = read_bytes(self._path)
        lines: Any = enumerate(content.splitlines(), 1) if json_lines else _rows(self._path, content)
        found = []
        for number, line in lines:
            place = f"{self._path}, line {number}"
            if json_lines and not line.strip():
                continue
            with self.noted(place):
                values = _json_values(line) if json_lines else _row_values(line)
                _check_columns(values, required, known)
                found.append(make(Entry(place, values)))
        if not found and not self._places:
            listed = ", ".join(required)
            raise InputError(f"{self._path}: has no lines with pairs; write one a line, with the columns {listed}")
        return found

    @contextlib.contextmanager
    def noted(self, place: str = "") -> Iterator[None]:
        """Notes an `InputError` of the block."""
        try:
            yield
        except InputError as error:
            self._places.setdefault(str(error).removeprefix(f"{place}: "), []).append(place)

    def tell(self) -> None:
        """Raises what was noted.

        Raises:
            InputError: something was: all of it, up to ten problems.
        """
        texts = [_at(places, text) for text, places in self._places.items()]
        if len(texts) == 1:
            raise InputError(texts[0])
        if texts:
            own = [text.removeprefix(f"{self._path}").lstrip(",: ") for text in texts[:MOST]]
            more = f"; and {len(texts) - MOST} more" if len(texts) > MOST else ""
            raise InputError(f"{self._path}: {len(texts)} errors: {'; '.join(own)}{more}")


def _at(places: Sequence[str], text: str) -> str:
    """A text with where it is so."""
    more = f" (the same in {len(places) - 1} more)" if len(places) > 1 else ""
    return f"{places[0]}: {text}{more}" if places[0] else text


def _check_columns(values: Mapping[str, Any], required: Sequence[str], known: Set[str]) -> None:
    if missing := [column for column in required if column not in values]:
        raise InputError(f"has no {' and no '.join(missing)}; every line needs {', '.join(required)}")
    if unknown := [str(column) for column in values if column not in known]:
        listed = ", ".join(shown(column) for column in unknown[:3])
        raise InputError(f"unknown column {listed}; known are {', '.join(sorted(known))}")


def check_files(path: Path, files: Mapping[str, Path]) -> None:
    """Checks that all files of a manifest are there.

    Raises:
        InputError: some are not; it lists them.
    """
    absent = [f"{what} {file}" for what, file in files.items() if not file.is_file()]
    if absent:
        listed = "; ".join(absent[:MOST]) + (f"; and {len(absent) - MOST} more" if len(absent) > MOST else "")
        raise InputError(f"{path}: {len(absent)} of its {len(files)} files do not exist: {listed}")


def settings_of(entry: Entry, folder: Path, config: DetectionConfig) -> DetectionConfig | None:
    """The settings of a line; None where it has none of its own.

    Raises:
        InputError: an unknown setting or a wrong value.
    """
    types = _setting_types()
    own = {name: value for name, value in entry.values.items() if name in types}
    if CONFIG not in entry.values and not own:
        return None
    try:
        file = {} if CONFIG not in entry.values else _file_settings(folder / str(entry.values[CONFIG]))
        values = {name: _value(name, value, types[name]) for name, value in own.items()}
        if isinstance(values.get("verdict"), str):
            values["verdict"] = str(folder / values["verdict"])
        return DetectionConfig.from_dict({**config.to_dict(), **file, **values})
    except InputError as error:
        raise InputError(f"{entry.place}: {error}") from error


def _file_settings(path: Path) -> dict[str, Any]:
    settings = read_toml(path)
    if isinstance(settings.get("verdict"), str):
        settings["verdict"] = str(path.parent / settings["verdict"])
    return settings


def _pair(entry: Entry, folder: Path, config: DetectionConfig) -> BatchPair:
    values = entry.values
    check_name(values["name"], f"{entry.place}: name")
    files = {role: folder / path_of(entry, role) for role in FILES if role in values}
    return BatchPair(values["name"], **files, config=settings_of(entry, folder, config))


def path_of(entry: Entry, role: str) -> str:
    """The path in a column of a line.

    Raises:
        InputError: it is no text.
    """
    value = entry.values[role]
    if not isinstance(value, str) or "\0" in value:
        raise InputError(f"{entry.place}: {role}={shown(value)} must be the path of a file")
    return value


def _rows(path: Path, content: bytes) -> list[tuple[int, Mapping[Any, Any]]]:
    """The rows of a table, by the numbers of their lines."""
    delimiter = DELIMITERS.get(path.suffix.lower())
    if delimiter is None:
        endings = ", ".join([*DELIMITERS, *JSON_LINES])
        raise InputError(f"{path}: is no manifest by its ending; name it {endings}, by what it holds")
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


def _row_values(row: Mapping[Any, Any]) -> dict[str, str]:
    if None in row:
        raise InputError("has more values than there are columns; quote values with commas")
    return {column: value.strip() for column, value in row.items() if value is not None and value.strip()}


def _json_values(line: bytes) -> dict[str, Any]:
    try:
        values = parse_json(line)
    except ValueError as error:
        raise InputError(f"is not JSON ({one_line(error)}); write an object a line") from error
    if not isinstance(values, dict):
        raise InputError(f"is {shown(values)}; write an object, such as " + '{"name": "hall", ...}')
    settings = values.pop("settings", {})
    if not isinstance(settings, dict):
        raise InputError(f"settings={shown(settings)} must be an object of settings by name")
    return {name: own for name, own in {**settings, **values}.items() if own is not None}


def _setting_types() -> dict[str, Any]:
    return typing.get_type_hints(DetectionConfig)


def _value(name: str, value: Any, kind: Any) -> Any:
    """A setting; in a table it is a text."""
    if not isinstance(value, str):
        return value
    kinds = {*typing.get_args(kind), kind}
    if bool in kinds:
        return {"true": True, "false": False}.get(value.lower(), value)
    if str in kinds or typing.get_origin(kind) is typing.Literal:
        return value
    readers: Sequence[Callable[[str], Any]] = [int] if float not in kinds else [int, float]
    if name == "crop":
        readers = [lambda text: tuple(float(number) for number in text.split())]
    for read in readers:
        try:
            return read(value)
        except ValueError:
            continue
    return value


def _pair_in(folder: Path) -> BatchPair:
    check_name(folder.name, f"{folder}: name")
    clouds, views = NAMES.map(lambda side: _cloud(folder, side)), NAMES.map(lambda side: _views(folder, side))
    return BatchPair(folder.name, clouds.before, clouds.after, views.before, views.after)


def _cloud(folder: Path, side: str) -> Path:
    file = _one_of(folder, [side], tuple(READERS))
    if file is None:
        raise InputError(f"{folder}: has no file {side}, such as {side}.ply")
    return file


def _views(folder: Path, side: str) -> Path | None:
    return _one_of(folder, [name.format(side=side) for name in VIEWS], (".json", ".npz"))


def _one_of(folder: Path, stems: Sequence[str], endings: Sequence[str]) -> Path | None:
    """The file of a folder with one of these names; None where there is none."""
    found = [file for file in sorted(folder.iterdir()) if file.stem in stems and file.suffix.lower() in endings]
    if len(found) > 1:
        listed = ", ".join(file.name for file in found)
        raise InputError(f"{folder}: has {listed}, which could all be meant; leave one of them")
    return found[0] if found else None
