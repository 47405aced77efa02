"""Tables as CSV and Parquet, and any other file, whole or not at all."""

import csv
import dataclasses
import io
import types
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gmmjax.clouds import atomic_write
from gmmjax.errors import InputError


def write_table(folder: Path, name: str, kind: type, rows: Sequence[Any]) -> None:
    """Writes rows as NAME.csv and NAME.parquet; what is None is empty in the one and null in the other.

    Args:
        folder: that is there.
        name: of the files.
        kind: of the rows, a dataclass whose fields are the columns.
        rows: the rows.

    Raises:
        InputError: a file cannot be written.
    """
    columns = [field.name for field in dataclasses.fields(kind)]
    for ending, content in ((".csv", _csv), (".parquet", _parquet)):
        write_file(folder / f"{name}{ending}", content(kind, columns, rows))


def write_file(path: Path, content: bytes) -> None:
    """Writes a file whole or not at all.

    Raises:
        InputError: it cannot be written.
    """
    try:
        with atomic_write(path) as file:
            file.write(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); free some space") from error


def _csv(kind: type, columns: list[str], rows: Sequence[Any]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([getattr(row, column) for column in columns] for row in rows)
    return text.getvalue().encode()


def _parquet(kind: type, columns: list[str], rows: Sequence[Any]) -> bytes:
    import pyarrow
    from pyarrow import parquet

    hints = typing.get_type_hints(kind)
    arrow = {str: pyarrow.string(), int: pyarrow.int64(), float: pyarrow.float64(), bool: pyarrow.bool_()}
    schema = pyarrow.schema([(column, arrow[_plain(hints[column])]) for column in columns])
    values = {column: [getattr(row, column) for row in rows] for column in columns}
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.table(values, schema=schema), sink)
    return bytes(sink.getvalue())


def _plain(hint: Any) -> type:
    """The type of a column: of "int | None" it is int, of a choice of words it is str."""
    if isinstance(hint, types.UnionType):
        (hint,) = (part for part in typing.get_args(hint) if part is not type(None))
    return str if typing.get_origin(hint) is typing.Literal else hint
