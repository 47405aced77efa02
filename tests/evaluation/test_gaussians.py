import csv
import io
import json

import pytest

from gmmjax import DetectionConfig
from gmmjax.evaluation import CONDITIONS, Condition, evaluate_gaussians
from gmmjax.evaluation.gaussians import summary, to_csv, to_json, to_markdown


@pytest.fixture(scope="module")
def told():
    return []


@pytest.fixture(scope="module")
def rows(told):
    return evaluate_gaussians(
        ["greedy", "transport"],
        [20],
        conditions=[Condition(1, 0, "low"), Condition(1, 1, "low")],
        config=DetectionConfig(restarts=2),
        points=500,
        progress=lambda cell, share: told.append((cell, share)),
    )


def test_conditions_are_those_of_the_thesis():
    assert [str(condition) for condition in CONDITIONS[:4]] == ["(+1) low", "(+1) medium", "(+2) low", "(+2) medium"]
    assert str(CONDITIONS[-1]) == "(-1 +1) medium" and len(CONDITIONS) == 10


def test_methods_find_what_they_can(rows, told):
    """Both find one appearance; of a mixed pair Algorithm 1 finds one half, partial transport both."""
    scores = {(row.method, str(row.condition)): row.scores for row in rows}
    assert scores["greedy", "(+1) low"].f1 == scores["transport", "(+1) low"].f1 == 1
    assert scores["transport", "(-1 +1) low"].f1 == 1
    assert scores["greedy", "(-1 +1) low"].precision == 1
    assert all(row.right_components == 1 for row in rows)
    assert told[0] == ("greedy (+1) low", 0.0)


def test_tables_hold_every_row(rows):
    assert len(to_markdown(rows).splitlines()) == 2 + 4
    read = list(csv.DictReader(io.StringIO(to_csv(rows))))
    assert [line["method"] for line in read] == ["greedy", "greedy", "transport", "transport"]
    assert float(read[2]["f1"]) == 1
    content = json.loads(to_json(rows))
    assert len(content["rows"]) == 4
    assert content["summary"]["transport"]["f1_mixed"] == summary(rows)["transport"]["f1_mixed"] == 1
