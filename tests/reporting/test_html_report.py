import dataclasses
import json
import re

import numpy as np
import pytest

from gmmjax.clouds import PointCloud
from gmmjax.reporting import report_html
from gmmjax.reporting.scene_plot import MOST_UNCHANGED
from tests.reporting.conftest import labelled

HOSTILE = '</script><img src=x onerror=alert(1)>"&.ply'


def without_scripts(page):
    return re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)


def scene_of(page):
    return json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', page, re.DOTALL)[1])


@pytest.fixture(scope="module")
def page(pair):
    return report_html(*pair)


def test_answer_and_table(page):
    text = without_scripts(page)
    assert "<h1>3 changes: 1 appeared, 1 disappeared, 1 moved</h1>" in text
    assert "first.ply" in text
    assert "second.ply" in text
    assert text.count('<td class="kind">') == 3
    assert "1 row of the before cloud" in text


def test_nothing_is_loaded_from_anywhere(page):
    assert "http" not in without_scripts(page).replace("http-equiv", "")
    assert not re.search(r"<(script|img|link|iframe)[^>]*\s(src|href)=", page)
    assert "default-src 'none'" in page


def test_three_views_show_the_points_of_each_change(page):
    views = scene_of(page)["views"]
    assert list(views) == ["before", "after", "changes"]
    clouds = {name: sum(trace["mode"] == "markers" for trace in traces) for name, traces in views.items()}
    assert clouds == {"before": 1 + 1, "after": 1 + 2, "changes": 2 + 3}
    numbers = {name: trace["text"] for name, traces in views.items() for trace in traces if trace["mode"] == "text"}
    assert numbers == {
        "before": ["<b>0</b>"],
        "after": ["<b>1</b>", "<b>2</b>"],
        "changes": [f"<b>{i}</b>" for i in range(3)],
    }


def test_each_change_says_why(pair, explained):
    text = without_scripts(report_html(*pair[:2], explained))
    assert text.count("<summary>Why: 92 % of it lies where the other survey looked through (+3.1)</summary>") == 3
    assert "changed 90 %, unchanged 8 %, not observed 2 %" in text
    bar = '<li><b>−1.3</b><span class="bar" aria-hidden="true"><span class="against" style="width:20.1%"></span></span>'
    assert bar + "<span>40 % of it continues planes of the other cloud</span></li>" in text
    # The fact that decided against a rejected candidate, not the strongest one.
    assert text.count("<summary>Why: 40 % of it continues planes of the other cloud (−1.3)</summary>") == 2
    assert "<summary>2 candidates were rejected</summary>" in text
    assert "<td>not observed</td><td>10 %</td><td>40</td>" in text
    assert "<details open" not in text


def test_without_explanations_there_is_no_why(page):
    assert "Why" not in without_scripts(page)
    assert "rejected" not in re.sub(r"<style>.*?</style>", "", without_scripts(page), flags=re.DOTALL)


def test_rejected_candidates_are_shown_where_nothing_changed(pair, explained):
    unchanged = labelled(explained, np.full(400, -1), np.full(500, -1), ())
    text = without_scripts(report_html(*pair[:2], unchanged))
    assert "<h1>No change found</h1>" in text
    assert "<summary>2 candidates were rejected</summary>" in text


def test_facts_that_say_next_to_nothing_have_no_bar(pair, explained):
    facts = tuple(dataclasses.replace(one, log_odds=0.0) for one in explained[0].explanation.contributions)
    own = dataclasses.replace(explained[0].explanation, contributions=facts)
    items = tuple(dataclasses.replace(item, explanation=own) for item in explained.items)
    text = without_scripts(report_html(*pair[:2], dataclasses.replace(explained, items=items, rejected=())))
    assert "<summary>Why</summary>" in text
    assert "3 facts together" in text
    assert 'class="bar' not in text


def test_hostile_sentences_are_text(pair, explained):
    fact = dataclasses.replace(explained[0].explanation.contributions[0], sentence=HOSTILE)
    own = dataclasses.replace(explained[0].explanation, contributions=(fact,))
    items = tuple(dataclasses.replace(item, explanation=own) for item in explained.items)
    rejected = tuple(dataclasses.replace(one, explanation=own) for one in explained.rejected)
    page = report_html(*pair[:2], dataclasses.replace(explained, items=items, rejected=rejected))
    assert "<img" not in without_scripts(page)
    assert without_scripts(page).count("&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt;") == 2 * (3 + 2)


def test_hostile_names_are_text(pair):
    before, after, changes = pair
    changes = dataclasses.replace(changes, diagnostics={HOSTILE: [HOSTILE, {HOSTILE: None}]})
    page = report_html(dataclasses.replace(before, source=HOSTILE), after, changes, title=HOSTILE)
    assert "<img" not in without_scripts(page)
    assert "<" not in re.search(r'id="scene">(.*?)</script>', page, re.DOTALL)[1]
    assert "onerror=alert(1)>" not in without_scripts(page)


def test_no_change(pair):
    before, after, changes = pair
    page = report_html(before, after, labelled(changes, np.full(400, -1), np.full(500, -1), ()))
    assert "<h1>No change found</h1>" in page
    assert "probability of 50 %" in page
    assert [len(traces) for traces in scene_of(page)["views"].values()] == [1, 1, 2]


def test_everything_changed(pair):
    before, after, changes = pair
    everything = labelled(changes, np.zeros(400, int), np.ones(500, int), changes.items)
    assert "3 changes" in report_html(before, after, everything)


def test_large_clouds_give_a_page_of_some_megabytes_that_says_what_it_leaves_out(pair):
    points = np.random.default_rng(0).normal(size=(250_000, 3)) + 1e6
    labels = np.where(np.arange(len(points)) < 50_000, 1, -1)
    changes = labelled(pair[2], labels, labels, pair[2].items)
    cloud = PointCloud.from_rows(points)
    page = report_html(cloud, cloud, changes)
    assert len(page) < 8e6
    assert f"{MOST_UNCHANGED + 15_000:,} of 250,000 points drawn" in page
    assert page == report_html(cloud, cloud, changes)


@pytest.mark.parametrize("shape", [[1, 1, 0], [1, 0, 0]])
def test_planes_and_lines_have_a_view(pair, shape):
    points = np.random.default_rng(0).normal(size=(400, 3)) * shape
    cloud = PointCloud.from_rows(points)
    changes = labelled(pair[2], np.full(400, -1), np.full(400, -1), ())
    scene = scene_of(report_html(cloud, cloud, changes))
    assert all(high > low for low, high in scene["ranges"].values())
    assert np.isfinite(list(scene["camera"]["eye"].values())).all()
