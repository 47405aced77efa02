"""The folder of a batch run: where everything is, what is done, and who may write there."""

import contextlib
import dataclasses
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from gmmjax import __version__
from gmmjax.batch.pair_record import PAIR_FILE, PairRecord, chosen_settings
from gmmjax.batch.rows import PairRow
from gmmjax.batch.scan_pair import check_name
from gmmjax.batch.tables import write_file
from gmmjax.changes import DetectionConfig
from gmmjax.clouds import FolderKind, check_output_folder, locked_file, read_json_record
from gmmjax.errors import InputError, one_line, shown

RUN_SCHEMA = 1
RUN_FILE = "run.json"
RUN = FolderKind("batch run", RUN_FILE, "pairs", ())
PAIRS, ERRORS = "pairs", "errors"


@dataclasses.dataclass(frozen=True)
class Shard:
    """A part of a run, the same whoever computes it: every `count`th pair, from the `number`th on.

    Attributes:
        number: from 1 to `count`.
        count: of all parts.

    Raises:
        InputError: a number that is not among them.
    """

    number: int
    count: int

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise InputError(f"shard {self}: the number must be from 1 to {max(self.count, 1)}, as in 3/100")

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """The shard that a text such as 3/100 names.

        Raises:
            InputError: it names none.
        """
        number, slash, count = text.partition("/")
        if not (slash and number.isascii() and number.isdigit() and count.isascii() and count.isdigit()):
            raise InputError(f"shard={shown(text)} must be a number and how many there are, as in 3/100")
        return cls(int(number), int(count))

    def of(self, pairs: Sequence[Any]) -> list[Any]:
        """The pairs of this part, from all of the run."""
        return list(pairs[self.number - 1 :: self.count])


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """The folder of a batch run.

    Attributes:
        path: of the folder.
    """

    path: Path

    def pair(self, name: str) -> Path:
        """The folder of a pair."""
        return self.path / PAIRS / name

    def error_file(self, name: str) -> Path:
        """Path of the file with the error of a pair that failed."""
        return self.path / ERRORS / f"{name}.json"

    @contextlib.contextmanager
    def locked(self, shard: Shard | None = None) -> Iterator[None]:
        """Keeps other runs out while the block runs; other shards of this one may be computed.

        Args:
            shard: the part that is computed; None: the whole.

        Raises:
            InputError: another process computes it.
        """
        with contextlib.ExitStack() as stack:
            try:
                stack.enter_context(locked_file(self.path, "run", shared=shard is not None))
                if shard is not None:
                    stack.enter_context(locked_file(self.path, f"shard-{shard.number}-of-{shard.count}"))
            except BlockingIOError:
                what = "this folder" if shard is None else f"this folder, or shard {shard}"
                raise InputError(
                    f"{self.path}: another run is computing {what}; wait until it is done, or choose another folder"
                ) from None
            yield

    def prepare(self, run: "RunRecord", *, overwrite: bool) -> None:
        """Makes the folder that of this run.

        Raises:
            InputError: the folder holds a run with other settings and not `overwrite`, or cannot be written.
        """
        if not overwrite and (previous := self.run_record()) is not None:
            run.check_settings(previous, self.path)
        run.write(self.path / RUN_FILE)
        for name in (PAIRS, ERRORS):
            _make_folder(self.path / name)

    def run_record(self) -> "RunRecord | None":
        """The record of the run; None where there is none.

        Raises:
            InputError: a record that is damaged.
        """
        file = self.path / RUN_FILE
        return RunRecord.read(file) if file.exists() else None

    def result(self, name: str) -> PairRecord | None:
        """The record of a pair; None where there is none that is whole."""
        try:
            return PairRecord.read(self.pair(name) / PAIR_FILE)
        except InputError:
            return None

    def failed(self, name: str) -> PairRow | None:
        """The row of a pair that failed when it was last tried; None where it did not."""
        try:
            content = read_json_record(self.error_file(name), RUN_SCHEMA, "start the run again")
            return PairRow(**content["pair"])
        except (InputError, KeyError, TypeError):
            return None

    def write_error(self, row: PairRow) -> None:
        """Writes why a pair failed; a result that is there from before stays.

        Raises:
            InputError: the file cannot be written.
        """
        _write_json(self.error_file(row.name), {"schema_version": RUN_SCHEMA, "pair": dataclasses.asdict(row)})

    def clear_error(self, name: str) -> None:
        """Forgets why a pair failed, where it did not in the end."""
        self.error_file(name).unlink(missing_ok=True)


@dataclasses.dataclass(frozen=True)
class RunRecord:
    """The pairs and settings of a run.

    Attributes:
        names: of all pairs, of all shards.
        settings: of the run by name, those that are not the default; without the restarts.
        series: what the epochs of a series are compared with, "previous"; None: it is no series.
        epochs: of a series, in their order.
        version: of gmmjax.
    """

    names: tuple[str, ...]
    settings: Mapping[str, Any]
    series: str | None = None
    epochs: tuple[str, ...] = ()
    version: str = __version__

    @classmethod
    def of(cls, names: Sequence[str], config: DetectionConfig, **series: Any) -> "RunRecord":
        """The record of a run with these settings."""
        return cls(tuple(names), chosen_settings(config), **series)

    def check_settings(self, previous: "RunRecord", folder: Path) -> None:
        """Checks that a folder is of a run with the same settings; more or other pairs, and restarts, may be asked for.

        Raises:
            InputError: it was made with other settings, which are named.
        """
        names = sorted({*self.settings, *previous.settings})
        other = [name for name in names if self.settings.get(name) != previous.settings.get(name)]
        other += ["series"] if self.series != previous.series else []
        if other:
            known = {**previous.settings, "series": previous.series}
            listed = ", ".join(f"{name} {shown(known.get(name, 'default'))}" for name in other[:3])
            raise InputError(
                f"{folder}: holds a run with other settings ({listed}); choose another folder, or --overwrite "
                "(overwrite=True) to compute its pairs again with these"
            )

    def write(self, path: Path) -> None:
        """Writes it as JSON.

        Raises:
            InputError: the file cannot be written.
        """
        content = {**dataclasses.asdict(self), "schema_version": RUN_SCHEMA}
        _write_json(path, {"pairs": list(content.pop("names")), **content})

    @classmethod
    def read(cls, path: Path) -> "RunRecord":
        """Reads what `write` wrote.

        Raises:
            InputError: the file is missing or damaged, or of another schema version.
        """
        remedy = "start the run again with --overwrite (overwrite=True), which writes it anew and keeps what is done"
        content = read_json_record(path, RUN_SCHEMA, remedy)
        try:
            names, epochs = tuple(map(str, content["pairs"])), tuple(map(str, content["epochs"]))
            for name in names:
                check_name(name)
            return cls(names, dict(content["settings"]), content["series"], epochs, str(content["version"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: is not the record of a run ({one_line(error)}); {remedy}") from error


def run_folder(path: Path) -> RunFolder:
    """The folder of a run; made where it is not there.

    Raises:
        InputError: it is a file, holds something else, or cannot be written.
    """
    if not (path / RUN_FILE).is_file():
        check_output_folder(path, RUN)
    _make_folder(path)
    return RunFolder(path)


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made ({error.strerror or error}); choose another output folder") from error


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    write_file(path, json.dumps(content, indent=1, allow_nan=False).encode())
