import dataclasses
import json
import re

import numpy as np
import pytest

from gmmjax.clouds import PointCloud
from gmmjax.reporting import report_html
from gmmjax.reporting.pictures import PictureSettings
from tests.changes.explained import displaced
from tests.reporting.conftest import labelled

HOSTILE = '</script><img src=x onerror=alert(1)>"&.ply'
SMALL = PictureSettings(width=80, height=60)


def without_scripts(page):
    return re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL)


def scene_of(page):
    return json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', page, re.DOTALL)[1])


def text_of(*arguments, **settings):
    return without_scripts(report_html(*arguments, close_ups=SMALL, **settings))


def moved_object(changes):
    """The first two changes as one object that moved by 2 in x and turned by 90 degrees."""
    motion = np.array([[0.0, -1, 0, 2], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    before, after, other = changes.items
    own = {"transform": motion, "moved_probability": 0.88, "kind": "moved"}
    items = (
        dataclasses.replace(before, partner=1, box=dataclasses.replace(before.box, centre=np.zeros(3)), **own),
        dataclasses.replace(after, partner=0, volume=0.25, **own),
        other,
    )
    return dataclasses.replace(changes, items=items, unit="m")


@pytest.fixture(scope="module")
def page(pair):
    return report_html(*pair, close_ups=SMALL)


def test_the_answer_and_what_was_compared(page):
    text = without_scripts(page)
    assert "<h1>3 changes: 1 appeared, 1 disappeared, 1 moved</h1>" in text
    assert "<bdi>first.ply</bdi></b> (400 points)" in text
    assert "<bdi>second.ply</bdi></b> (500 points)" in text
    assert "1 row of the before cloud" in text
    assert "under 1 % of the after cloud" in text
    assert len(re.findall(r'<li class="change \w+" id="change-\d"', text)) == 3


def test_how_much_was_not_observed_is_of_all_points_where_some_are_shown(pair):
    before, after, changes = pair
    some = dataclasses.replace(changes, unobserved_after=np.arange(len(after)) < 100)
    assert "20 % of the after cloud" in text_of(before, after, some)
    none_found = dataclasses.replace(
        labelled(changes, np.full(400, -1), np.full(5_000, -1), ()), unobserved_after=np.arange(5_000) < 350
    )
    assert "7 % of the after cloud" in text_of(before, after, some, recorded=none_found)


@pytest.mark.parametrize(
    ("lengths", "sentence"),
    [
        ({"voxel_size": 0.25, "finest_voxel_size": 0.25}, "Compared in voxels of 0.25."),
        ({"voxel_size": 0.25}, "Compared in voxels of 0.25."),
        (
            {"voxel_size": 0.25, "finest_voxel_size": 0.01},
            "Compared in voxels of 0.010 to 0.25, as small as both scans allow at each place.",
        ),
        ({"voxel_size": None, "finest_voxel_size": None}, None),
    ],
)
def test_the_resolution(pair, lengths, sentence):
    before, after, changes = pair
    changes = dataclasses.replace(changes, diagnostics={**changes.diagnostics, **lengths})
    text = without_scripts(report_html(before, after, changes, close_ups=SMALL))
    assert sentence in text if sentence else "Compared in voxels" not in text


def test_nothing_is_loaded_from_anywhere(page):
    assert "http" not in without_scripts(page).replace("http-equiv", "")
    assert not re.search(r"<(script|link|iframe)[^>]*\s(src|href)=", page)
    assert set(re.findall(r'<img src="([a-z:/]*);', page)) == {"data:image/webp"}
    assert "default-src 'none'" in page


def test_a_moved_object_is_one_row(pair):
    text = text_of(*pair[:2], moved_object(pair[2]))
    assert "<h1>2 changes: 1 appeared, 1 moved</h1>" in text
    assert 'data-labels="0 1"' in text
    assert "<b>moved 2.00 m, turned 90°</b>" in text
    for name, value in {"Same object": "88 %", "Moved by": "2.00 m", "Turned by": "90°", "Volume": "0.25 m³"}.items():
        assert f"<dt>{name}</dt><dd>{value}</dd>" in text


def test_the_size_and_the_volume_of_a_row_break_between_each_other_only(pair):
    """A row is narrow: a number without its unit, or cut off, would be another number."""
    item = dataclasses.replace(pair[2][0], volume=0.01, volume_error=0.04)
    text = report_html(*pair[:2], dataclasses.replace(pair[2], items=(item, *pair[2].items[1:]), unit="m"))
    assert re.search(r"<small><span>[^<]* m</span> · <span>[^<]*0\.01[^<]* m³</span></small>", text)
    assert re.search(r"\.what small span \{\s*white-space: ?nowrap", text)


def test_sizes_and_positions_are_those_of_the_record(pair):
    text = text_of(*pair[:2], dataclasses.replace(pair[2], unit="mm"))
    for name, values in {"Size": pair[2][0].box.extent, "Position": pair[2][0].mean}.items():
        shown = re.search(rf"<dt>{name}</dt><dd>([^<]*) mm</dd>", text)[1]
        np.testing.assert_allclose([float(one) for one in re.split(r" × |, ", shown)], values, atol=0.006)


def test_each_change_has_close_ups_up_to_a_number_of_them(pair, monkeypatch):
    assert text_of(*pair).count("Close-up of change") == 2 * 3
    monkeypatch.setattr("gmmjax.reporting.html_changes.MAX_WITH_PICTURES", 1)
    few = without_scripts(report_html(*pair, close_ups=SMALL))
    assert few.count("Close-up of change") == 2
    assert "Close-ups are made of the 1 most probable changes." in few


def test_each_change_says_why(pair, explained):
    text = text_of(*pair[:2], explained)
    assert text.count("<p>changed 90 %, unchanged 8 %, not observed 2 %</p>") == 3
    bar = '<li><b>−1.3</b><span class="bar" aria-hidden="true"><span class="against" style="width:20.1%"></span></span>'
    assert bar + "<span>40 % of it continues planes of the other cloud</span></li>" in text
    assert "<summary>2 candidates were rejected</summary>" in text
    assert "<b>not observed</b><small>would have appeared: 40 % of it continues planes of the other cloud" in text
    assert "<details open" not in text


def test_more_than_six_facts_are_shown_on_request(pair, explained):
    facts = tuple(
        dataclasses.replace(explained[0].explanation.contributions[0], sentence=f"fact {n}") for n in range(8)
    )
    own = dataclasses.replace(explained[0].explanation, contributions=facts)
    items = (dataclasses.replace(explained[0], explanation=own), *explained.items[1:])
    text = text_of(*pair[:2], dataclasses.replace(explained, items=items))
    first, more = text.split("<summary>2 more facts</summary>")
    assert [f"fact {n}<" in first for n in range(8)] == [True] * 6 + [False] * 2
    assert all(f"fact {n}<" in more for n in (6, 7))


def test_without_explanations_there_is_no_why(page):
    assert "<h3>Why</h3>" not in page
    assert "rejected-section" not in without_scripts(page)
    assert 'data-toggle="rejected"' not in page


def test_toggles_are_offered_where_the_scene_has_what_they_show(pair, page):
    assert scene_of(page)["has"] == {"scan": True, "distance": False, "unobserved": True}
    assert 'data-toggle="unobserved"' in page
    assert '<option value="scan">' in page
    assert '<option value="distance">' not in page
    before, after, changes = pair
    measured = dataclasses.replace(
        labelled(changes, changes.labels_before, changes.labels_after, changes.items),
        distance_before=np.zeros(400),
        distance_after=np.full(500, 0.2),
    )
    other = report_html(dataclasses.replace(before, colors=None), after, measured, close_ups=SMALL)
    assert '<option value="distance">' in other
    assert '<option value="scan">' not in other
    assert 'data-toggle="unobserved"' not in other


def test_stations_are_offered_where_some_were_recognised(pair, page):
    assert scene_of(page)["stations"] == []
    assert 'data-toggle="stations"' not in page
    recognised = {"after": {"recognised_stations": [[0.0, 0.0, 1.5]]}}
    changes = dataclasses.replace(pair[2], diagnostics={**pair[2].diagnostics, **recognised})
    assert 'data-toggle="stations"' in report_html(*pair[:2], changes, close_ups=SMALL)


def test_warnings_are_at_the_top(pair):
    changes = dataclasses.replace(pair[2], warnings=("the registration is in doubt", HOSTILE))
    head = text_of(*pair[:2], changes).split("</header>")[0]
    assert "the registration is in doubt</p>" in head
    assert "&lt;/script&gt;&lt;img src=x" in head


def test_rejected_candidates_are_shown_where_nothing_changed(pair, explained):
    unchanged = labelled(explained, np.full(400, -1), np.full(500, -1), ())
    text = text_of(*pair[:2], unchanged)
    assert "<h1>No change found</h1>" in text
    assert "<summary>2 candidates were rejected</summary>" in text
    assert 'data-toggle="rejected"' in text
    assert 'data-toggle="gaussians"' not in text


def test_a_displaced_surface_that_is_no_change_is_told_above_the_rejected_candidates(pair, explained):
    text = text_of(*pair[:2], dataclasses.replace(explained, rejected=(displaced(0.64, 9000),)))
    assert "Most of the 9,000 points at " in text.split('<details class="rejected"')[0]
    assert "judged unchanged" not in text_of(*pair[:2], explained)


def test_facts_that_say_next_to_nothing_have_no_bar(pair, explained):
    facts = tuple(dataclasses.replace(one, log_odds=0.0) for one in explained[0].explanation.contributions)
    own = dataclasses.replace(explained[0].explanation, contributions=facts)
    items = tuple(dataclasses.replace(item, explanation=own) for item in explained.items)
    text = text_of(*pair[:2], dataclasses.replace(explained, items=items, rejected=()))
    assert "3 facts together" in text
    assert 'class="bar' not in text


def test_hostile_sentences_are_text(pair, explained):
    fact = dataclasses.replace(explained[0].explanation.contributions[0], sentence=HOSTILE)
    own = dataclasses.replace(explained[0].explanation, contributions=(fact,))
    items = tuple(dataclasses.replace(item, explanation=own) for item in explained.items)
    rejected = tuple(dataclasses.replace(one, explanation=own) for one in explained.rejected)
    text = text_of(*pair[:2], dataclasses.replace(explained, items=items, rejected=rejected))
    assert "<img src=x" not in text
    # Of a rejected candidate also in its row.
    assert text.count("&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt;") == 3 + 2 * 2


@pytest.mark.parametrize("name", [HOSTILE, "\x1b[31mred\x00\u202e.ply", "скан 扫描 (1).ply"])
def test_hostile_names_are_text(pair, name):
    before, after, changes = pair
    changes = dataclasses.replace(changes, diagnostics={name: [name, {name: None}]}, unit=name)
    page = report_html(dataclasses.replace(before, source=name), after, changes, title=name, close_ups=SMALL)
    text = without_scripts(page)
    assert "<img src=x" not in text
    assert not set(text) & {"\x1b", "\x00"}
    assert "<" not in re.search(r'id="scene">(.*?)</script>', page, re.DOTALL)[1]
    assert "onerror=alert(1)>" not in text


def test_no_change(pair):
    before, after, changes = pair
    page = report_html(before, after, labelled(changes, np.full(400, -1), np.full(500, -1), ()), close_ups=SMALL)
    assert "<h1>No change found</h1>" in page
    assert "probability of 50 %" in page
    assert scene_of(page)["changes"] == []
    assert 'id="view-main"' in page


def test_everything_changed(pair):
    before, after, changes = pair
    everything = labelled(changes, np.zeros(400, int), np.ones(500, int), changes.items)
    assert "3 changes" in report_html(before, after, everything, close_ups=SMALL)


def test_large_clouds_give_a_page_of_some_megabytes_that_says_what_it_leaves_out(pair, monkeypatch):
    points = np.random.default_rng(0).normal(size=(100_000, 3)) + 1e6
    labels = np.where(np.arange(len(points)) < 20_000, 1, -1)
    changes = labelled(pair[2], labels, labels, pair[2].items)
    cloud = PointCloud.from_rows(points)
    page = report_html(cloud, cloud, changes, close_ups=SMALL)
    assert len(page) < 5e6
    assert page == report_html(cloud, cloud, changes, close_ups=SMALL)


@pytest.mark.parametrize("shape", [[1, 1, 0], [1, 0, 0]])
def test_planes_and_lines_have_a_view(pair, shape):
    points = np.random.default_rng(0).normal(size=(400, 3)) * shape
    cloud = PointCloud.from_rows(points)
    changes = labelled(pair[2], np.full(400, -1), np.full(400, -1), ())
    shown = scene_of(report_html(cloud, cloud, changes, close_ups=SMALL))["shown"]
    assert (np.array(shown["upper"]) > np.array(shown["lower"])).all()
