import dataclasses
import re
from html.parser import HTMLParser
from urllib.parse import unquote

import numpy as np
import pytest

from gmmjax.batch import ObjectEvent, ObjectHistory
from gmmjax.changes import Box
from gmmjax.errors import InputError
from gmmjax.pair import Pair
from gmmjax.reporting import timeline_html
from gmmjax.reporting.plan_view import plan_svg
from gmmjax.reporting.timeline_page import Stretch, series_answer, stretches

EPOCHS = ("Mon", "Tue", "Wed", "Thu", "Fri")
NAMES = {(epoch - 1, epoch): f"night {epoch}" for epoch in range(1, 5)}
HOSTILE = "</script><img src=x onerror=alert(1)>\"&' #?%."


def box(x, y=0.0):
    return Box(np.array([x, y, 0.2]), np.array([0.4, 0.3, 0.2]), np.eye(3))


def event(kind, epoch, where=0.0, **fields):
    values = {
        "previous": epoch - 1,
        "probability": 0.97,
        "moved_probability": None,
        "box": box(where),
        "origin": None,
        "distance": None,
        "point_count": 1234,
        "comparison": Pair(epoch - 1, epoch),
        "change": 0,
        "overlap": 1.0,
    }
    return ObjectEvent(kind=kind, epoch=epoch, **(values | fields))


def moved(epoch, origin, where):
    return event("moved", epoch, where, origin=box(origin), distance=abs(where - origin), moved_probability=0.8)


def history(number, events, presence, frame=0):
    return ObjectHistory(number, EPOCHS, frame, tuple(events), presence)


HISTORIES = (
    history(1, [event("came", 1), moved(2, 0.0, 0.42), event("went", 4, 0.42)], (False, True, True, True, False)),
    history(2, [moved(1, 2.0, 1.0), moved(3, 1.0, 3.0)], (True,) * 5),
    history(3, [event("went", 2, 5.0)], (True, True, False, False, False)),
)


def page_of(histories=HISTORIES, epochs=EPOCHS, names=NAMES, title="The hall"):
    return timeline_html(title, epochs, histories, names)


class Elements(HTMLParser):
    """The start tags of a page, with their attributes; fails where an element is not closed."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.open = [], []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in ("meta", "br", "img"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def of(self, tag):
        return [attributes for own, attributes in self.tags if own == tag]


def body(page):
    return re.sub(r"<(style|script).*?</\1>", "", page, flags=re.DOTALL)


@pytest.mark.parametrize(
    ("histories", "answer"),
    [
        (HISTORIES, "5 epochs, 3 objects: 1 came, 2 moved (3 times in all), 2 went"),
        (HISTORIES[1:2], "5 epochs, 1 object: 1 moved twice"),
        (HISTORIES[2:], "5 epochs, 1 object: 1 went"),
        ((), "5 epochs: no object came, moved or went"),
    ],
)
def test_answer(histories, answer):
    assert series_answer(EPOCHS, histories) == answer
    assert f"<h1>{answer}</h1>" in page_of(histories)


def test_objects_are_rows_with_bars_and_events():
    elements = Elements(page_of())
    rows = [row["data-object"] for row in elements.of("li") if "data-object" in row]
    assert rows == ["1", "2", "3"]
    marks = [(link["class"], link["style"], link["href"]) for link in elements.of("a") if "class" in link]
    assert marks == [
        ("mark came", "--at:1", "pairs/night%201/report.html"),
        ("mark moved", "--at:2", "pairs/night%202/report.html"),
        ("mark went", "--at:4", "pairs/night%204/report.html"),
        ("mark moved", "--at:1", "pairs/night%201/report.html"),
        ("mark moved", "--at:3", "pairs/night%203/report.html"),
        ("mark went", "--at:2", "pairs/night%202/report.html"),
    ]
    text = body(page_of())
    assert "Object 1 moved by 0.42 in Wed: probability 97 %, the same object 80 %" in text
    assert "<small>0.42 · 97 %</small>" in text


@pytest.mark.parametrize(
    ("presence", "expected"),
    [
        ((False, True, True, False), [Stretch(1.5, 3.5, True)]),
        ((True, True, False), [Stretch(0, 2.5, True)]),
        ((False, True), [Stretch(1.5, 2, True)]),
        ((True, None, True), [Stretch(0, 0.5, True), Stretch(0.5, 2.5, False), Stretch(2.5, 3, True)]),
        ((False, None, True), [Stretch(0.5, 2.5, False), Stretch(2.5, 3, True)]),
        ((True, None, None), [Stretch(0, 1, True), Stretch(1, 3, False)]),
        ((None, True, False), [Stretch(0, 1, False), Stretch(1, 2.5, True)]),
        ((False, True, False, False, True), [Stretch(1.5, 2.5, True), Stretch(4.5, 5, True)]),
    ],
)
def test_bars(presence, expected):
    assert stretches(history(1, [event("came", 1)], presence)) == expected


def test_an_epoch_without_comparison_is_marked_and_said():
    names = {(0, 1): "a", (1, 3): "b", (3, 4): "c"}
    went = history(1, [event("went", 3, previous=1, comparison=Pair(1, 3))], (True, True, None, False, False))
    page = page_of([went], names=names)
    assert "Compared with no other epoch: <b>Wed</b>." in page
    assert '<span class="gap" style="--at:2">' in page
    assert "went between Tue and Thu" in page
    assert "Compared with no other epoch" not in page_of()


def test_a_gap_that_no_comparison_bridges_is_said_and_has_a_plan_of_its_own():
    names = {(0, 1): "a", (1, 2): "b", (3, 4): "c"}
    histories = [
        history(1, [event("came", 1)], (False, True, True, None, None)),
        history(2, [event("went", 4)], (None, None, None, True, False), frame=3),
    ]
    page = page_of(histories, names=names)
    assert "followed up to <b>Wed</b>, and anew from <b>Thu</b> on" in page
    assert [f"frame of {name}<" in page for name in EPOCHS] == [True, False, False, True, False]
    assert len(Elements(page).of("svg")) == 2


def test_an_event_without_a_change_says_so():
    gone = history(
        1,
        [event("came", 1), event("went", 3, change=None, overlap=None)],
        (False, True, True) + (False,) * 2,
    )
    page = page_of([gone])
    assert "went in Thu: probability 97 %, it no longer differs from Wed" in page
    assert 'href="pairs/night%203/report.html"' in page


def test_what_is_back_is_said():
    back = history(1, [event("went", 1), event("came", 3, returned=True)], (True, False, False, True, True))
    assert "Object 1 came back in Thu" in page_of([back])


def test_an_event_of_a_pair_without_a_name_has_no_link():
    elements = Elements(page_of(names={}))
    assert [link["href"] for link in elements.of("a")] == ["objects.csv"]
    assert sum("mark" in span.get("class", "").split() for span in elements.of("span")) == 6


def test_nothing_changed():
    page = page_of(())
    assert "No change was found between the 5 epochs." in page
    assert Elements(page).of("svg") == []
    assert "No two epochs were compared." in page_of((), names={})
    assert "0 epochs" in page_of((), epochs=(), names={})


def test_nothing_is_loaded_from_anywhere():
    page = page_of()
    assert "http" not in body(page).replace("http-equiv", "")
    assert not re.search(r"<(script|img|link|iframe)[^>]*\s(src|href)=", page)
    assert "default-src 'none'" in page


def test_hostile_names_are_text_and_links_are_encoded():
    epochs = (HOSTILE,) * 5
    histories = [dataclasses.replace(one, epochs=epochs) for one in HISTORIES]
    names = dict.fromkeys(NAMES, HOSTILE)
    page = page_of(histories, epochs, names, HOSTILE)
    elements = Elements(page)
    assert "<img" not in page
    assert {tag for tag, attributes in elements.tags if "onerror" in attributes} == set()
    links = {link["href"] for link in elements.of("a")} - {"objects.csv"}
    (link,) = links
    assert re.fullmatch(r"pairs/[\w.%~-]+/report\.html", link)
    assert unquote(link) == f"pairs/{HOSTILE}/report.html"


def test_bad_input():
    with pytest.raises(InputError, match="4 and 5 are not the indices"):
        page_of(names={(4, 5): "x"})


def test_many_epochs_and_objects_stay_small():
    epochs = [f"night {epoch}" for epoch in range(200)]
    histories = [
        ObjectHistory(
            number,
            tuple(epochs),
            0,
            (event("came", 1 + number % 198, float(number)), moved(199, float(number), number + 1.0)),
            (False,) * 100 + (True,) * 100,
        )
        for number in range(1, 501)
    ]
    page = page_of(histories, epochs, names={(198, 199): "x"})
    assert len(page) < 2e6
    assert "--widest:22px" in page
    assert 'class="timeline upright"' in page


def test_the_plan_has_a_box_for_each_place_and_the_paths_between():
    svg = plan_svg(HISTORIES)
    assert svg.count('class="track"') == 3
    assert [svg.count(f'<polygon class="{kind}"') for kind in ("came", "moved", "went", "origin")] == [1, 3, 2, 3]
    numbers = [float(value) for value in re.findall(r"-?\d+\.\d", " ".join(re.findall(r'points="([^"]*)"', svg)))]
    assert min(numbers) >= 0
    assert max(numbers) <= 560


def test_the_plan_is_seen_from_above():
    """x to the right, y upwards: on the page, where y is down, the northern box is the upper one."""
    north, south = (history(1, [event("came", 1, box=box(0.0, y))], (False,) + (True,) * 4) for y in (2.0, -2.0))
    shapes = re.findall(r'points="([^"]*)"', plan_svg([north, south]))
    heights = [np.mean([float(corner.split(",")[1]) for corner in shape.split()]) for shape in shapes]
    assert heights[0] < heights[1]


def test_numbers_of_objects_in_one_place_do_not_cover_each_other():
    """Two deep: a number that made way for one may not lie on another."""
    objects = [history(number, [event("came", 1)], (False,) + (True,) * 4) for number in (9, 10, 11)]
    heights = [float(y) for y in re.findall(r'<text x="[^"]*" y="([^"]*)">\d+</text>', plan_svg(objects))]
    assert min(np.diff(sorted(heights))) >= 15


@pytest.mark.parametrize("extent", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1e-9, 1e-9, 0.0)])
def test_a_plan_of_next_to_nothing_is_finite(extent):
    flat = dataclasses.replace(box(1e5), extent=np.array(extent))
    svg = plan_svg([history(1, [event("came", 1, box=flat)], (False,) + (True,) * 4)])
    assert "nan" not in svg
    assert "inf" not in svg
