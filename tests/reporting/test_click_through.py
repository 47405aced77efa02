"""A headless browser clicks through reports; where node, Chromium or playwright-core are missing, nothing is tested."""

import dataclasses
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from gmmjax.reporting import report_html
from tests.browser import CHROMIUM, needs_browser
from tests.changes.explained import explanation, rejected
from tests.reporting.conftest import change, labelled

pytestmark = needs_browser


def clicked_through(folder, clouds, changes):
    """What the script says; its complaint where it fails."""
    changes.save(folder)
    (folder / "report.html").write_text(report_html(*clouds, changes), encoding="utf-8")
    script = Path(__file__).with_name("click_through.mjs")
    files = folder / "report.html", folder / "changes.json"
    done = subprocess.run(["node", script, CHROMIUM, *files], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def yard(pair):
    """A floor with colours; a crate that came, one that went, and one that moved; something that was turned down."""
    random = np.random.default_rng(5)
    floor = np.c_[random.uniform(-3, 3, (5000, 2)), random.normal(0, 0.005, 5000)]
    crate = random.uniform([0, 0, 0], [0.8, 0.6, 0.5], (500, 3))
    gone, was, came, now = (crate + np.array([x, y, 0]) for x, y in [(-2, -2), (-2, 1), (1, -2), (0.2, 1.4)])
    points = Pair(np.concatenate([floor, gone, was]), np.concatenate([floor, came, now]))
    labels = np.r_[np.full(5000, -1), np.zeros(500, int), np.ones(500, int)]
    motion = np.eye(4)
    motion[:2, 3] = 2.2, 0.4
    own = {"transform": motion, "moved_probability": 0.9}
    items = (
        change("disappeared", gone),
        dataclasses.replace(change("moved", was, partner=3), **own),
        dataclasses.replace(change("appeared", came, probability=0.8), volume=0.24),
        dataclasses.replace(change("moved", now, partner=1), **own),
    )
    items = tuple(dataclasses.replace(item, explanation=explanation()) for item in items)
    after = np.where(labels < 0, -1, labels + 2)
    unobserved = Pair(*(cloud[:, 0] > 2.5 for cloud in points))
    changes = dataclasses.replace(
        labelled(pair[2], labels, after, items),
        unobserved_before=unobserved.before,
        unobserved_after=unobserved.after,
        distance_before=points.before[:, 2],
        distance_after=points.after[:, 2],
        rejected=(rejected(),),
        diagnostics={
            "before": {"recognised_stations": [[0.0, 0.0, 1.5]]},
            "after": {"recognised_stations": [[1.0, 0.5, 1.5]]},
        },
        warnings=("the registration is in doubt",),
        unit="m",
    )
    colors = random.integers(60, 200, (6000, 3)).astype(np.uint8)
    names = Pair("<b>first</b> scan.ply", "second \u202e\x1b[31m.ply")
    return Pair(
        PointCloud.from_rows(points.before, colors=colors, source=names.before),
        PointCloud.from_rows(points.after, colors=colors, source=names.after),
    ), changes


def test_every_row_toggle_and_key_of_a_report_does_something(tmp_path, yard):
    assert clicked_through(tmp_path, *yard) == "3 rows\n"


def test_a_report_without_changes_still_has_its_view(tmp_path, yard):
    clouds, changes = yard
    nothing = labelled(changes, np.full(6000, -1), np.full(6000, -1), ())
    nothing = dataclasses.replace(nothing, rejected=(), warnings=(), diagnostics={})
    assert clicked_through(tmp_path, clouds, nothing) == "0 rows\n"
