import dataclasses
import json
import re

import numpy as np
import pytest

from gmmjax.evaluation import Failure
from gmmjax.thesis.chapter4 import (
    Outcome,
    PartResult,
    Plan,
    ThesisResults,
    clustering,
    filtering,
    gaussians,
    grid,
    surveys,
)
from gmmjax.thesis.chapter4.accuracy import Confusion
from gmmjax.thesis.report import thesis_html
from gmmjax.thesis.report.bar_charts import condition_chart, found_chart, score_chart
from gmmjax.thesis.report.chapter_text import THESIS_TEXT

COUNTS = {
    "all": dataclasses.asdict(Confusion(1, 1, 1, 0, 3)),
    "overlap": dataclasses.asdict(Confusion(2, 0, 1, 0, 3)),
    "opposite": dataclasses.asdict(Confusion(0, 1, 0, 0, 3)),
}


def mixture(count):
    means = np.arange(3.0 * count).reshape(count, 3)
    return {
        "weights": [1 / count] * count,
        "means": means.tolist(),
        "covariances": np.tile(0.1 * np.eye(3), (count, 1, 1)).tolist(),
    }


def cloud(drawn):
    places = np.arange(2 * drawn).reshape(drawn, 2).tolist()
    kept, changed = [True] * (drawn - 1) + [False], [False] * (drawn - 1) + [True]
    return {"places": places, "kept": kept, "changed": changed, "points": 100 * drawn, "left": 90 * drawn}


def clustered(cloud, seed, best, method="grid search"):
    return Outcome(cloud, seed, method, {}, {"best": best, "found": [best, 5], "mixture": mixture(best)})


OUTCOMES = {
    grid: [
        Outcome(cloud, 0, "grid search", {}, {"scores": dict.fromkeys(("mdl", "bic", "aic"), scores)})
        for cloud, scores in (("4 Gaussians", np.arange(24.0).reshape(4, 6).tolist()), ("7 Gaussians", [[5.0] * 6] * 4))
    ],
    clustering: [
        *(clustered(cloud, 0, 4, method) for cloud in clustering.CLOUDS for method in ("annihilation", "grid search")),
        clustered("7 Gaussians", 1, 7),
        clustered("7 Gaussians", 2, 6),
        Outcome("4 to 7 Gaussians", 0, "changes", {}, {"mixture": mixture(3)}),
    ],
    filtering: [
        Outcome("localised maps", 0, "clouds", {}, {"before": cloud(5), "after": cloud(6)}),
        Outcome(filtering.WITH, 0, "joint", {}, COUNTS),
    ],
    gaussians: [Outcome("(+1) low", 0, "joint", {}, COUNTS)],
    surveys: [Outcome("single frames", 0, "published", {}, COUNTS)],
}


def part(module, notes=()):
    outcomes = OUTCOMES[module]
    return PartResult(
        module.PART, tuple(module.tables(outcomes)), tuple(module.headlines(outcomes)), tuple(outcomes), notes
    )


@pytest.fixture(scope="module")
def page():
    parts = tuple(part(module, ("No <volumetric> maps.",) if module is surveys else ()) for module in OUTCOMES)
    return thesis_html(ThesisResults(Plan(), parts, (Failure("a", "b", "c"),)))


def charts_of(page):
    return json.loads(re.search(r'<script type="application/json" id="charts">(.*?)</script>', page)[1])


def test_every_figure_is_on_the_page_beside_what_the_thesis_says(page):
    for figure, said in THESIS_TEXT.items():
        section = re.search(rf'<section class="thesis" id="figure-{figure}">.*?</section>', page, re.DOTALL)[0]
        assert f"<h2>Figure {figure}: " in section and said in section
        assert f'href="figure-{figure}.csv"' in section
    assert page.index("figure-3.9") < page.index('id="figure-4.1"') < page.index('id="figure-4.12"')


def test_every_chart_has_a_place_and_every_place_a_chart(page):
    charts = charts_of(page)
    places = re.findall(r'<div class="(?:chart|view)" id="([^"]+)"', page)
    assert sorted(places) == sorted(charts)
    assert {"annihilation-2", "grid-2", "clouds-4.6", "chart-4.12"} <= set(charts)
    assert all(
        trace["type"] in ("bar", "scatter", "scatter3d", "surface") for own in charts.values() for trace in own["data"]
    )


def test_the_page_needs_nothing_else(page):
    assert page.count("Content-Security-Policy") == 1
    assert not re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="', page)


def test_notes_and_failures_are_shown(page):
    assert "No &lt;volumetric&gt; maps." in page
    assert "1 unit of the work failed" in page


def test_a_part_that_could_not_be_run_says_why():
    nothing = PartResult("filtering", (), (), (), ("install open3d",))
    html = thesis_html(ThesisResults(Plan(), (nothing,), ()))
    assert "install open3d" in html and charts_of(html) == {}


def test_the_lowest_score_of_each_panel_is_marked():
    (table,) = grid.tables(OUTCOMES[grid])
    chart = score_chart(table)
    assert len(chart["data"]) == 6
    for trace in chart["data"]:
        marked = [place for place, text in enumerate(trace["text"]) if text]
        assert marked == [int(np.argmin(trace["y"]))]
        assert len(set(trace["marker"]["color"])) == 2


def test_shares_of_the_fits_by_the_number_that_they_found():
    traces = {(own["name"], own["xaxis"]): own for own in found_chart(OUTCOMES[clustering])["data"]}
    scanned = traces["grid search", "x2"]
    assert scanned["x"] == [4, 6, 7] and scanned["y"] == [pytest.approx(1 / 3)] * 3
    assert traces["annihilation, one start", "x"]["x"] == [4, 5]


def test_the_conditions_stand_with_the_right_number_of_the_thesis():
    (table,) = gaussians.tables(OUTCOMES[gaussians])
    (said, *_) = [own for own in condition_chart(table)["data"] if own["name"].startswith("F1 of the thesis")]
    by_condition = dict(zip(zip(*said["x"], strict=True), said["y"], strict=True))
    assert by_condition["low overlap", "(-1 +1)"] == by_condition["medium overlap", "(-1 +1)"] == 0.52
    assert by_condition["low overlap", "(+2)"] == by_condition["medium overlap", "(-1)"] == 0.8
    assert [trace["y"][0] for trace in condition_chart(table)["data"][:4]] == [0.8, 0.5, 1, 0.6667]


def test_the_filter_leaves_points_out_of_the_second_picture(page):
    left, right = (
        sum(len(trace["x"]) for trace in charts_of(page)["clouds-4.6"]["data"] if trace["xaxis"] == axis)
        for axis in ("x", "x2")
    )
    assert (left, right) == (11, 9)
