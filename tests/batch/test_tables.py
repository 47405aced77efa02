import csv

import pytest
from pyarrow import parquet

from gmmjax.batch import ChangeRow, PairRow, write_table
from gmmjax.errors import InputError

PAIRS = (
    PairRow('a "b", <c>', "done", before="x.ply", changes=2, highest_probability=0.75, registration_applied=True),
    PairRow("Büro\u2028", "failed", "no such\tfile"),
)
CHANGES = (ChangeRow('a "b", <c>', 0, "moved", 0.75, None, 0.9, 12.5, 300, 1, 1.0, -2.0, 1e-300, 3.0, 2.0, 1.0),)


def test_both_formats_hold_the_rows(tmp_path):
    write_table(tmp_path, "pairs", PairRow, PAIRS)
    write_table(tmp_path, "changes", ChangeRow, CHANGES)
    with (tmp_path / "pairs.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["name"], row["error"], row["changes"]) for row in rows] == [
        (PAIRS[0].name, "", "2"),
        (PAIRS[1].name, "no such\tfile", ""),
    ]
    table = parquet.read_table(tmp_path / "pairs.parquet").to_pylist()
    assert [PairRow(**row) for row in table] == list(PAIRS)
    assert [ChangeRow(**row) for row in parquet.read_table(tmp_path / "changes.parquet").to_pylist()] == list(CHANGES)


def test_columns_have_their_types_without_rows(tmp_path):
    write_table(tmp_path, "changes", ChangeRow, ())
    schema = parquet.read_schema(tmp_path / "changes.parquet")
    assert str(schema.field("probability").type) == "double"
    assert str(schema.field("partner").type) == "int64"
    assert (tmp_path / "changes.csv").read_text().startswith("name,change,kind,probability")


def test_a_table_that_cannot_be_written(tmp_path):
    (tmp_path / "pairs.csv").mkdir()
    with pytest.raises(InputError, match=r"pairs\.csv: is a folder"):
        write_table(tmp_path, "pairs", PairRow, PAIRS)
