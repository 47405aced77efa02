"""What a reader sees of the pages of a run, in a browser: wide and narrow, light and dark, and on paper."""

import csv
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from gmmjax.clouds import write_ply
from tests.batch.runs import FLAGS, cloud, run
from tests.browser import CHROMIUM, needs_browser

pytestmark = needs_browser
PAGES = ("index", "timeline", "report")
MODES = ("wide", "wide, dark", "phone", "phone, dark", "paper")


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What is seen of each page of a series of five epochs, the fourth of which cannot be read."""
    folder = tmp_path_factory.mktemp("scans of a building")
    # Two Gaussians come, one of them to the place of one that went, and go.
    shown = [[0, 1, 2], [0, 1, 3], [0, 2], [0, 2], [0, 2, 3]]
    rows = [["name", "cloud"]]
    for night, gaussians in enumerate(shown):
        points = cloud(night).reshape(5, -1, 3)[gaussians].reshape(-1, 3)
        colors = np.random.default_rng(night).integers(40, 220, (len(points), 3)).astype(np.uint8)
        write_ply(folder / f"{night}.ply", points, colors=colors)
        rows.append([f"night {night}", f"{night}.ply"])
    (folder / "3.ply").write_bytes((folder / "3.ply").read_bytes()[:-99])
    with (folder / "epochs.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    out = folder / "run"
    done = run(folder / "epochs.csv", "--out", out, "--series", "--workers", "1", *FLAGS)
    assert "3 of 5 pairs done, 2 failed" in done.stdout, done.stdout + done.stderr
    pages = [out / "index.html", out / "timeline.html", out / "pairs" / "night 0 to night 1" / "report.html"]
    words = ["node", Path(__file__).with_name("visible.mjs"), CHROMIUM, *pages]
    looked = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert looked.returncode == 0, looked.stderr
    return dict(zip(PAGES, json.loads(looked.stdout).values(), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("page", PAGES)
def test_every_text_is_seen_whole_and_readable(seen, page, mode):
    """Inside the window, under nothing, in a colour that stands out, and no row breaks."""
    found = {name: value for name, value in seen[page][mode].items() if name not in ("pictures", "overflow")}
    assert found == {name: [] for name in ("hidden", "covered", "faint", "overlapping", "uneven", "errors")}
    assert seen[page][mode]["overflow"] <= 0


@pytest.mark.parametrize("mode", MODES)
def test_thumbnails_are_seen(seen, mode):
    colors = seen["index"][mode]["pictures"]
    assert len(colors) == 2 * 3
    assert min(colors.values()) > 20, colors


@pytest.mark.parametrize("mode", MODES)
def test_the_plan_is_seen(seen, mode):
    (colors,) = seen["timeline"][mode]["pictures"].values()
    assert colors > 20


@pytest.mark.parametrize("mode", MODES)
def test_the_report_has_views_and_on_paper_pictures(seen, mode):
    colors = seen["report"][mode]["pictures"]
    shown = [count for name, count in colors.items() if name.startswith("IMG" if mode == "paper" else "CANVAS")]
    assert len(shown) >= 3
    assert min(shown) > 20, colors
