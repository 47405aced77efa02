"""How a record of changes shows itself: in short, as a data frame, as a report, in notebooks."""

import builtins
import dataclasses
import re
import sys
from html.parser import HTMLParser
from typing import ClassVar

import numpy as np
import pytest

from gmmjax import Changes, InputError, PointCloud, SensorViews, detect_changes
from gmmjax.changes import ChangeColumns, DetectionConfig, Registration, change_columns, presented
from gmmjax.changes.storage import OPTIONAL_ARRAYS
from gmmjax.pair import Pair
from tests.batch.runs import SETTINGS
from tests.batch.runs import cloud as gaussians
from tests.changes.explained import rejected
from tests.changes.test_record import example
from tests.reporting.conftest import change


def boxes():
    """A box that was at the origin, and is at (1, 0, 0)."""
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (40, 3))
    return Pair(points, points + np.array([1.0, 0, 0]))


@pytest.fixture
def changes():
    before, after = boxes()
    return dataclasses.replace(
        example(),
        labels_before=np.zeros(40, int),
        labels_after=np.ones(40, int),
        probability_before=np.ones(40),
        probability_after=np.ones(40),
        unobserved_before=np.zeros(40, bool),
        unobserved_after=np.zeros(40, bool),
        **dict.fromkeys(OPTIONAL_ARRAYS),
        items=(change("disappeared", before), change("appeared", after, probability=0.999)),
        clouds=Pair(PointCloud.from_rows(before, source="a <b> $x$.ply"), after),
        unit="m",
    )


@pytest.fixture
def moved(changes):
    """The same as one object, which turned by 90 degrees about z."""
    motion = np.array([[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    items = tuple(
        dataclasses.replace(item, kind="moved", partner=1 - label, transform=motion, mean=centre, box=box)
        for label, item in enumerate(changes)
        for centre in [np.array([label, 0.0, 0.0])]
        for box in [dataclasses.replace(item.box, centre=centre)]
    )
    return dataclasses.replace(changes, items=items)


def test_records_are_short_in_a_console(changes, moved):
    assert repr(changes) == "<Changes: 1 appeared, 1 disappeared; 40 and 40 points>"
    assert repr(moved) == "<Changes: 1 moved; 40 and 40 points>"
    nothing = dataclasses.replace(changes, items=())
    assert repr(nothing) == "<Changes: no change; 40 and 40 points>"
    assert repr(moved[1]) == "<Change: moved, probability 1.00, 40 points at (1, 0, 0)>"
    assert repr(rejected()).startswith("<RejectedCandidate: disappeared, unchanged, probability 0.")
    cloud = PointCloud.from_rows(np.eye(3), np.zeros((3, 3), np.uint8), {"a\nb": np.zeros(3)}, source="x\x1b[2J.ply")
    assert repr(cloud) == "<PointCloud: 3 points, colours, fields 'a\\nb'; 'x\\x1b[2J.ply'>"
    assert repr(SensorViews(np.eye(4)[None], (60, 45), 20)) == "<SensorViews: 1 view of 60° × 45°, range 20>"


def test_every_change_is_a_row_of_the_data_frame(changes, moved):
    frame = moved.to_dataframe()
    assert list(frame.columns) == [field.name for field in dataclasses.fields(ChangeColumns)][1:]
    assert frame.index.name == "change" and frame.attrs["unit"] == "m"
    # Both changes of a moved object say how it moved.
    np.testing.assert_allclose(frame["displacement"], [1, 1])
    np.testing.assert_allclose(frame["rotation_degrees"], [90, 90])
    assert frame["partner"].tolist() == [1, 0] and str(frame["partner"].dtype) == "Int64"
    plain = changes.to_dataframe()
    assert plain["kind"].tolist() == ["disappeared", "appeared"] and plain["displacement"].isna().all()
    np.testing.assert_array_equal(plain[["extent_1", "extent_2", "extent_3"]], [one.box.extent for one in changes])
    assert [row.point_count for row in change_columns(changes)] == plain["point_count"].tolist() == [40, 40]
    empty = dataclasses.replace(changes, items=()).to_dataframe()
    assert len(empty) == 0 and (empty.dtypes == plain.dtypes).all()


def test_without_pandas_the_extra_is_named(changes, monkeypatch):
    real = builtins.__import__

    def missing(name, *arguments, **options):
        if name == "pandas":
            raise ModuleNotFoundError("No module named 'pandas'", name="pandas")
        return real(name, *arguments, **options)

    monkeypatch.delitem(sys.modules, "pandas", raising=False)
    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(InputError, match=r"to_dataframe needs pandas.*pip install 'gmmjax\[pandas\]'"):
        changes.to_dataframe()


def test_the_clouds_of_a_detection_are_remembered_by_reference_and_not_saved(tmp_path):
    before, after = gaussians(0, 4), PointCloud.from_rows(gaussians(1))
    found = detect_changes(before, after, config=DetectionConfig(**SETTINGS))
    assert found.clouds.before is before and found.clouds.after is after
    assert "clouds" not in found.to_dict()
    loaded = Changes.load(found.save(tmp_path))
    assert loaded.clouds is None
    with pytest.raises(InputError, match=r"before: the changes do not know their clouds, as after Changes.load"):
        loaded.report(tmp_path / "report.html")
    written = loaded.report(tmp_path / "new" / "report.html", before, after)
    assert written.read_text() == found.report(tmp_path / "same.html").read_text()


def test_rows_without_a_position_keep_the_labels_in_order(changes):
    rows = np.concatenate([boxes().before, np.full((2, 3), np.nan)])[::-1]
    labels = np.r_[-1, -1, np.zeros(40, int)]
    given = dataclasses.replace(
        changes,
        labels_before=labels,
        probability_before=labels / 1.0,
        unobserved_before=labels < 0,
        distance_before=np.arange(42.0),
        significance_before=np.arange(42.0) * 2,
        clouds=Pair(rows, changes.clouds.after),
    )
    clouds, shown = presented(given)
    np.testing.assert_array_equal(clouds.before.points, boxes().before[::-1])
    assert shown.labels_before.tolist() == [0] * 40 and not shown.unobserved_before.any()
    np.testing.assert_array_equal(shown.distance_before, np.arange(2.0, 42))
    np.testing.assert_array_equal(shown.significance_before, np.arange(2.0, 42) * 2)
    assert shown.labels_after is given.labels_after


def test_a_report_that_cannot_be_written_leaves_nothing(changes, tmp_path):
    with pytest.raises(InputError, match=r"is a folder; name the file, such as .*report.html"):
        changes.report(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"file.*cannot be written"):
        changes.report(tmp_path / "file" / "report.html")
    with pytest.raises(InputError, match="before: has 3 points, the changes have labels for 40"):
        changes.report(tmp_path / "x.html", before=np.eye(3))
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


class Fragment(HTMLParser):
    """The elements of a fragment, whose tags must be closed in order."""

    VOID: ClassVar = {"img", "br"}

    def __init__(self, text):
        super().__init__()
        self.open, self.attributes, self.texts = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.attributes.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def test_a_notebook_shows_a_row_for_each_object_and_a_picture(moved):
    shown = Fragment(moved._repr_html_())
    assert "1 change: 1 moved" in shown.texts and any("moved 1.00 m, turned 90°" in text for text in shown.texts)
    pictures = [attributes for tag, attributes in shown.attributes if tag == "img"]
    assert len(pictures) == 2 and all(one["src"].startswith("data:image/webp;base64,UklGR") for one in pictures)
    assert [tag for tag, _ in shown.attributes].count("tr") == 2
    # Names are text, and nothing is fetched or run.
    assert any("a <b> $x$.ply" in text for text in shown.texts)
    tags = [tag for tag, _ in shown.attributes]
    assert tags.count("b") == 1 and not {"script", "link", "style"} & set(tags)
    assert not re.search(r"(src|href)=\"(?!data:)", moved._repr_html_())
    # Colours of its own only for the kinds: the rest is the notebook's, light or dark.
    colors = [one["style"] for _, one in shown.attributes if "style" in one and "background" in one["style"]]
    assert colors == []


def test_a_notebook_shows_a_loaded_record_without_a_picture(moved):
    text = dataclasses.replace(moved, clouds=None)._repr_html_()
    assert "<img" not in text and "<table" in text


def test_a_long_table_ends_with_how_many_are_left(changes):
    many = dataclasses.replace(
        changes, items=(*changes.items, *(changes[0],) * 43), clouds=None, registration=Registration.none()
    )
    shown = Fragment(many._repr_html_())
    assert [tag for tag, _ in shown.attributes].count("tr") == 21
    assert any("and 25 more" in text for text in shown.texts)


def test_no_change_is_said(changes):
    nothing = dataclasses.replace(changes, items=(), labels_before=np.full(40, -1), labels_after=np.full(40, -1))
    text = nothing._repr_html_()
    assert "No change found" in text and "<table" not in text
