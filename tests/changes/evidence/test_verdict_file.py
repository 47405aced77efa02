import json

import numpy as np
import pytest

from gmmjax import DetectionConfig, detect_changes
from gmmjax.changes.evidence.verdict_file import SHIPPED, Verdicts, read_verdicts, shipped_verdicts, write_verdicts
from gmmjax.errors import InputError
from tests.changes.evidence.verdicts import verdict


def test_what_is_written_is_read_to_six_digits(tmp_path):
    verdicts = Verdicts(verdict({"excess": 1 / 3}, bias=(0.1, -2.0)), verdict({"seen_free": 5.0}, poses=True))
    write_verdicts(tmp_path / "verdict.json", verdicts, {"families": ["rooms"]})
    again = read_verdicts(tmp_path / "verdict.json")
    for was, now in ((verdicts.poses_unknown, again.poses_unknown), (verdicts.poses_given, again.poses_given)):
        assert now.names == was.names
        for name in ("weights", "bias", "bend", "centre", "spread", "lower", "upper"):
            np.testing.assert_allclose(getattr(now, name), getattr(was, name), rtol=1e-5)
    assert json.loads((tmp_path / "verdict.json").read_text())["made"] == {"families": ["rooms"]}


def test_writing_what_was_read_gives_the_same_file(tmp_path):
    write_verdicts(tmp_path / "again.json", shipped_verdicts(), json.loads(SHIPPED.read_text())["made"])
    assert (tmp_path / "again.json").read_bytes() == SHIPPED.read_bytes()


def damaged(path, change):
    content = json.loads(SHIPPED.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.update(schema_version=99), "schema version 99"),
        (lambda content: content.pop("poses_given"), "no poses_given"),
        (lambda content: content["poses_unknown"]["facts"].pop("excess"), "poses_unknown, excess: changed"),
        (lambda content: content["poses_unknown"]["facts"].update(luck={}), "a fact 'luck'"),
        (lambda content: content["poses_given"]["bias"].update(changed=float("nan")), "is not JSON .NaN"),
        (lambda content: content["poses_given"]["facts"]["gap"].update(spread=0.0), "gap: spread must be positive"),
        (lambda content: content["poses_given"]["facts"]["gap"].update(centre="far"), "gap: centre.*'far'"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_by_name(tmp_path, change, message):
    path = damaged(tmp_path / "mine.json", change)
    with pytest.raises(InputError, match=f"mine.json.*{message}"):
        read_verdicts(path)


def test_detection_names_the_file_that_it_cannot_use(tmp_path):
    floor = np.random.default_rng(0).uniform(size=(2000, 3)) * [1, 1, 0]
    with pytest.raises(InputError, match=r"none\.json"):
        detect_changes(floor, floor, config=DetectionConfig(restarts=1, verdict=str(tmp_path / "none.json")))
