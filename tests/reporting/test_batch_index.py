import json
import re
import subprocess

import numpy as np
import pytest

from gmmjax.batch import ChangeRow, PairRow
from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from gmmjax.reporting import batch_index_html, write_thumbnails
from tests.browser import CHROMIUM
from tests.reporting.conftest import labelled

HOSTILE = "</script><img src=x onerror=alert(1)> 100%#?\"'&"
# What a folder may be called, and a part of an address may not.
ODD = "scan 7 <b>&\"' 100%41#?+ä"


def pair_row(name, probability=None, changes=0, **values):
    return PairRow(name=name, status="done", changes=changes, highest_probability=probability, **values)


def change_row(name, index=0, kind="appeared", probability=0.9, partner=None):
    place = dict.fromkeys(("centre_x", "centre_y", "centre_z"), 0.0)
    values = {"standard_error": None, "moved_probability": None, "significance": 9.0, "point_count": 80}
    extent = {"extent_1": 1.23123123, "extent_2": 0.5, "extent_3": 0.25}
    return ChangeRow(name, index, kind, probability, partner=partner, **values, **place, **extent)


def failed_row(name, error):
    return PairRow(name=name, status="failed", error=error)


def content_of(page):
    return json.loads(re.search(r'<script type="application/json" id="run">(.*?)</script>', page, re.DOTALL)[1])


def without_scripts(page):
    return re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL)


@pytest.mark.parametrize(
    ("pairs", "missing", "answer"),
    [
        ([pair_row("a", 0.9, 2), pair_row("b")], [], "2 pairs done; 1 with changes"),
        ([pair_row("a")], [], "1 pair done; none with changes"),
        (
            [pair_row("a", 0.9, 1), failed_row("b", "e"), failed_row("c", "e")],
            ["d"],
            "1 of 4 pairs done, 2 failed, 1 missing; 1 with changes",
        ),
        ([], ["a", "b"], "0 of 2 pairs done, 2 missing"),
    ],
)
def test_the_heading_is_the_answer(pairs, missing, answer):
    page = batch_index_html("Every night", pairs, [], missing=missing)
    assert f"<h1>{answer}</h1>" in page
    assert "Every night" in without_scripts(page)


def test_every_pair_of_the_run_is_in_it_in_the_natural_order_of_names():
    names = [f"Night {number}" for number in (1, 2, 9, 10, 11, 100)]
    pairs = [pair_row(names[3]), failed_row(names[0], "no such file"), pair_row(names[5]), pair_row(names[1])]
    listed = content_of(batch_index_html("run", pairs, [], missing=[names[4], names[2].lower()]))["pairs"]
    assert [values[0].capitalize() for values in listed] == names
    assert [values[1] if len(values) > 1 else "missing" for values in listed] == [
        *("failed", "done", "missing", "done", "missing", "done")
    ]


def test_the_order_of_the_rows_does_not_matter():
    pairs = [pair_row(name, warnings=f"{name}\nboth") for name in "abc"]
    changes = [change_row(name) for name in "abc"]
    page = batch_index_html("run", pairs, changes)
    assert page == batch_index_html("run", pairs[::-1], changes[::-1])


def test_a_moved_object_is_listed_once():
    changes = [change_row("a", 0, "moved", partner=2), change_row("a", 1), change_row("a", 2, "moved", partner=0)]
    content = content_of(batch_index_html("run", [pair_row("a", 0.9, 2)], changes))
    kinds = [name for name, _ in content["kinds"]]
    assert [kinds[found[0]] for found in content["pairs"][0][-1]] == ["moved", "appeared"]


def test_only_certainty_is_one():
    pairs = [pair_row("certain", 1.0, 1), pair_row("nearly", 0.999999, 1)]
    certain, nearly = content_of(batch_index_html("run", pairs, []))["pairs"]
    assert 1 in certain
    assert 0.9999 in nearly
    assert 1.0 not in nearly[8:9]


def test_names_paths_and_messages_are_no_markup():
    pairs = [
        pair_row(HOSTILE, 0.9, 1, before=HOSTILE, after=HOSTILE, warnings=HOSTILE),
        failed_row(HOSTILE + "2", HOSTILE),
    ]
    page = batch_index_html(HOSTILE, pairs, [change_row(HOSTILE)], missing=[HOSTILE + "3"])
    assert "<img" not in without_scripts(page)
    assert "<" not in re.search(r'id="run">(.*?)</script>', page, re.DOTALL)[1]
    content = content_of(page)
    assert [values[0] for values in content["pairs"]] == [HOSTILE, HOSTILE + "2", HOSTILE + "3"]
    assert content["texts"] == [HOSTILE]


def test_nothing_is_loaded_but_images_beside_it():
    page = batch_index_html("run", [pair_row("a")], [])
    assert "http" not in without_scripts(page).replace("http-equiv", "")
    assert not re.search(r"<(script|img|link|iframe)[^>]*\s(src|href)=", page)
    assert "default-src 'none'" in page
    assert "img-src 'self' file:;" in page


def test_ten_thousand_pairs_are_a_page_of_less_than_four_megabytes():
    """Measured with a tenth of them: every pair adds as much."""
    random = np.random.default_rng(0)
    pairs, changes = [], []
    for number in range(1_000):
        name, folder = f"building {number % 97} night {number}", f"/data/surveys/{number % 97}/night-{number}"
        numbers = {
            field: float(random.random())
            for field in ("standard_error", "registration_residual", "registration_overlap", "registration_confidence")
        }
        files = {"before": f"{folder}/before.ply", "after": f"{folder}/after.ply", "warnings": "in different units"}
        sizes = {"points_before": 54_321, "points_after": 65_432, "restarts": 16, "seconds": float(random.random())}
        pairs.append(pair_row(name, float(random.random()), 3, **numbers, **files, **sizes))
        changes += [change_row(name, index, probability=float(random.random())) for index in range(3)]
    page = batch_index_html("run", pairs, changes)
    empty = len(batch_index_html("run", [], []).encode())
    assert empty + 10 * (len(page.encode()) - empty) < 4e6
    assert page.count("in different units") == 1


# Clicks through the page as a reader does, and leaves what it saw in its own element.
READER = """
const wait = () => new Promise((done) => setTimeout(done, 0));
const look = () => [...document.querySelectorAll("tbody tr b[dir]")].map((name) => name.textContent);
const said = () => document.querySelector("[role=status]").textContent;
const press = (label) => [...document.querySelectorAll("button")]
  .find((button) => button.textContent.startsWith(label)).click();
const type = (text) => {
  const search = document.querySelector("input");
  search.value = text;
  search.dispatchEvent(new Event("input"));
};
const sorted = () => [...document.querySelectorAll("[aria-sort]")]
  .map((heading) => `${heading.textContent} ${heading.getAttribute("aria-sort")}`);
addEventListener("load", async () => {
  const seen = {};
  const note = (key) => { seen[key] = { names: look(), said: said(), sorted: sorted(), hash: location.hash }; };
  seen.images = [...document.images].map(({ alt, naturalWidth }) => [alt, naturalWidth]);
  seen.links = [...document.querySelectorAll("tbody a[href]")].map((link) => link.getAttribute("href"));
  seen.row = document.querySelector("tbody tr").textContent;
  note("first");
  press("Pair"); note("by name");
  press("Pair"); note("by name, reversed");
  press("Next"); note("second page");
  press("Failed"); note("failed");
  press("All"); type("BOTH moved"); note("search");
  type("no such thing"); note("nothing");
  location.hash = "#sort=name&order=up&page=2"; await wait(); await wait(); note("from the address");
  location.hash = "#sort=constructor&show=x&page=-3"; await wait(); await wait(); note("nonsense");
  seen.markup = document.querySelectorAll("main script, td img[src=x]").length;
  const report = document.createElement("pre");
  report.id = "seen";
  report.textContent = JSON.stringify(seen);
  document.body.append(report);
});
"""


def in_browser(page):
    """The document of a page in Chromium after its scripts."""
    if CHROMIUM is None:
        pytest.skip("there is no Chromium")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={page.parent / 'profile'}"]
    options += ["--window-size=1500,900", "--virtual-time-budget=4000", "--dump-dom"]
    done = subprocess.run([CHROMIUM, *options, page.as_uri()], capture_output=True, text=True, timeout=60)
    if done.returncode:
        pytest.skip("Chromium does not start here")
    return done.stdout


@pytest.fixture(scope="module")
def seen(pair, tmp_path_factory):
    """What a reader sees of a run of 63 pairs in Chromium, from a file."""
    folder = tmp_path_factory.mktemp("run")
    (folder / "pairs" / ODD).mkdir(parents=True)
    clouds = Pair(*(PointCloud.from_rows(cloud.points) for cloud in pair[:2]))
    changes = labelled(pair[2], np.full(400, -1), np.full(500, -1), ())
    write_thumbnails(folder / "pairs" / ODD, clouds, changes)
    pairs = [
        pair_row(ODD, 0.99, 2, warnings="both scans are coarse"),
        *(pair_row(f"night {number}", number / 100, 1) for number in range(1, 61)),
        failed_row(HOSTILE, f"{HOSTILE}; copy it again"),
    ]
    rows = [change_row(ODD, probability=0.996), change_row(ODD, 1, "moved", 0.7)]
    page = batch_index_html("run", pairs, rows, missing=["zz"])
    (folder / "index.html").write_text(page.replace("</body>", f"<script>{READER}</script></body>"), "utf-8")
    dom = in_browser(folder / "index.html")
    content = re.search(r'<pre id="seen">(.*?)</pre>', dom, re.DOTALL)[1]
    return json.loads(content.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))


def test_thumbnails_and_links_work_from_a_file_whatever_the_name(seen):
    assert seen["images"][:2] == [[f"{ODD}, before", 320], [f"{ODD}, after", 320]]
    assert "pairs/scan%207%20%3Cb%3E%26%22'%20100%2541%23%3F%2B%C3%A4/report.html" in seen["links"]
    assert seen["markup"] == 0


def test_a_row_says_what_was_found(seen):
    for text in (ODD, "appeared 99 %", "moved 70 %", "1.23 × 0.50 × 0.25", "both scans are coarse"):
        assert text in seen["row"]


def test_the_highest_probability_comes_first_and_what_is_not_known_last(seen):
    assert seen["first"]["names"][:3] == [ODD, "night 60", "night 59"]
    assert seen["first"]["said"] == "1 to 50 of 63 pairs, highest probability first"
    assert seen["first"]["sorted"] == ["Probability descending"]
    assert seen["first"]["hash"] == ""


def test_a_heading_sorts_and_sorts_the_other_way(seen):
    assert seen["by name"]["names"][:4] == [HOSTILE, "night 1", "night 2", "night 3"]
    assert seen["by name"]["sorted"] == ["Pair ascending"]
    assert seen["by name, reversed"]["names"][:3] == ["zz", ODD, "night 60"]
    assert seen["by name, reversed"]["sorted"] == ["Pair descending"]
    assert seen["second page"]["names"][-2:] == ["night 1", HOSTILE]
    assert seen["second page"]["hash"] == "#sort=name&page=2"


def test_filters_and_searches(seen):
    assert seen["failed"]["names"] == [HOSTILE]
    assert seen["search"]["names"] == [ODD]
    assert seen["search"]["hash"] == "#q=BOTH+moved&sort=name"
    assert seen["nothing"]["names"] == []
    assert seen["nothing"]["said"] == "No such pair"


def test_an_address_leads_to_what_it_showed(seen):
    assert seen["from the address"]["names"][0] == "night 50"
    assert len(seen["from the address"]["names"]) == 13
    assert seen["nonsense"]["names"] == seen["first"]["names"]


def test_a_run_of_which_nothing_is_known_is_listed_by_name(tmp_path):
    page = tmp_path / "index.html"
    page.write_text(batch_index_html("run", [failed_row("b", "no such file")], [], missing=["a"]), "utf-8")
    dom = in_browser(page)
    assert "2 pairs, by name</p>" in dom
    assert "no such file" in without_scripts(dom)
    assert re.findall(r'<b dir="auto">(\w+)</b>', dom) == ["a", "b"]
    assert "Probability</button>" not in dom
