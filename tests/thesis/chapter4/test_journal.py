import json

import pytest

from gmmjax import InputError
from gmmjax.thesis.chapter4 import Journal
from gmmjax.thesis.chapter4.records import Unit


def unit(**fields):
    common = {"part": "a", "condition": "b", "seed": 0, "method": "c", "settings": {"d": (1, 2)}, "run": dict}
    return Unit(**{**common, **fields})


def test_what_was_added_is_there_when_the_file_is_read_again(tmp_path):
    journal = Journal(tmp_path / "journal.jsonl")
    journal.add(unit(), {"value": [1, 2.5], "pair": (3, 4)})
    again = Journal(tmp_path / "journal.jsonl")
    assert unit() in again and len(again) == 1
    assert again.result(unit()) == journal.result(unit()) == {"value": [1, 2.5], "pair": [3, 4]}


@pytest.mark.parametrize(
    "other", [{"part": "x"}, {"condition": "x"}, {"seed": 1}, {"method": "x"}, {"settings": {"d": (1, 3)}}]
)
def test_a_unit_is_known_by_all_that_its_result_depends_on(tmp_path, other):
    journal = Journal(tmp_path / "journal.jsonl")
    journal.add(unit(), {"value": 1})
    assert unit(**other) not in journal


@pytest.mark.parametrize("cut", [1, 10])
def test_a_line_that_was_being_written_is_lost_alone(tmp_path, cut):
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    journal.add(unit(), {"value": 1})
    journal.add(unit(seed=1), {"value": 2})
    path.write_bytes(path.read_bytes()[:-cut])
    again = Journal(path)
    assert unit() in again and unit(seed=1) not in again
    again.add(unit(seed=2), {"value": 3})
    assert [json.loads(line)["result"]["value"] for line in path.read_text().splitlines()] == [1, 3]
    assert len(Journal(path)) == 2


@pytest.mark.parametrize(
    "damage",
    [
        lambda line: "nonsense",
        lambda line: "[1]",
        lambda line: line.replace("1.5", "2.5"),
        lambda line: line.replace('"value"', '"worth"'),
        lambda line: line.replace("1.5", "NaN"),
    ],
)
def test_damage_elsewhere_is_named(tmp_path, damage):
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    for seed in range(3):
        journal.add(unit(seed=seed), {"value": 1.5})
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], damage(lines[1]), lines[2], ""]))
    with pytest.raises(InputError, match=r"journal\.jsonl: line 2 is damaged; .*--overwrite"):
        Journal(path)


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    journal = Journal(tmp_path / "nowhere" / "journal.jsonl")
    with pytest.raises(InputError, match=r"journal\.jsonl: cannot be written"):
        journal.add(unit(), {})
