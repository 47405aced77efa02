import csv

import pytest

from gmmjax.batch import PairRow, write_table
from gmmjax.errors import InputError

PAIRS = (
    PairRow('a "b", <c>', "done", before="x.ply", changes=2, highest_probability=0.75, registration_applied=True),
    PairRow("Büro\u2028", "failed", "no such\tfile"),
)


def test_a_table_holds_the_rows(tmp_path):
    write_table(tmp_path / "pairs.csv", list(vars(PAIRS[0])), map(vars, PAIRS))
    with (tmp_path / "pairs.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["name"], row["error"], row["changes"]) for row in rows] == [
        (PAIRS[0].name, "", "2"),
        (PAIRS[1].name, "no such\tfile", ""),
    ]


def test_a_table_without_rows_has_its_columns(tmp_path):
    write_table(tmp_path / "changes.csv", ["name", "change"], [])
    assert (tmp_path / "changes.csv").read_text() == "name,change\n"


def test_a_table_that_cannot_be_written(tmp_path):
    (tmp_path / "pairs.csv").mkdir()
    with pytest.raises(InputError, match=r"pairs\.csv: is a folder"):
        write_table(tmp_path / "pairs.csv", ["name"], [])
