"""The pictures of pages in the documentation: `python -m tests.benchmarks.report_pictures --out docs/images`.

It makes the scenes, detects their changes, clicks through every report and takes pictures of it, of the index of a
batch run and of the time line of a series. It needs node, Chromium, and `npm ci` in `gmmjax/reporting/viewer`.
"""

import argparse
import csv
import json
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmmjax.changes import Changes
from gmmjax.cli import main as gmmjax
from gmmjax.clouds import PointCloud, write_ply
from gmmjax.evaluation import family_sources
from gmmjax.pair import Pair
from gmmjax.reporting import write_result
from tests.batch.series_scenes import series
from tests.benchmarks import report_scenes
from tests.browser import CHROMIUM, MISSING

HERE = Path(__file__).parent
CLICK_THROUGH = HERE.parent / "reporting" / "click_through.mjs"
# A page of two million points, and a picture for the documentation, bytes.
LARGEST_PAGE, LARGEST_PICTURE = 12_000_000, 300_000
# Of the batch run: a family of scenes, its seed, and the name of the pair.
PLACES = (
    ("halls", 2, "Hall 3, 11 May"),
    ("kitchens", 3, "Staff kitchen"),
    ("doors", 2, "Fire door, ground floor"),
    ("tabletop", 4, "Bench 12"),
    ("small_motions", 1, "Plant room"),
    ("corridors", 0, "Corridor B2"),
    ("rooms", 4, "Office 2.14"),
)
CUT_OFF = "Loading dock, 4 May"
NIGHTS = ("Mon 2 Nov", "Tue 3 Nov", "Wed 4 Nov", "Thu 5 Nov", "Fri 6 Nov", "Sat 7 Nov", "Sun 8 Nov", "Mon 9 Nov")
LOST_NIGHT = 4


class Shot(NamedTuple):
    """A picture of a page.

    Attributes:
        scene: whose result it is.
        name: of the picture.
        width: of the window, pixels.
        height: of the window, pixels.
        dark: whether in dark colours.
        scale: pixels of the picture for one of the window.
        keys: that are pressed first.
        clicks: on the first element that each selector finds, after the keys.
        page: of the result.
    """

    scene: str
    name: str
    width: int = 1440
    height: int = 900
    dark: bool = False
    scale: float = 1.0
    keys: tuple[str, ...] = ()
    clicks: tuple[str, ...] = ()
    page: str = "report.html"


SHOTS = (
    Shot("Every night", "batch-index", 1500, 1060, page="index.html"),
    Shot("Store room", "timeline", 1400, 780, page="timeline.html"),
    Shot("demo", "report", 1500, page="result/report.html"),
    Shot("hall", "report-hall"),
    Shot("hall", "report-hall-change", keys=("j", "j")),
    Shot("table", "report-table", clicks=("#changes li.moved .row",)),
    Shot("table", "report-table-dark", dark=True, keys=("c",)),
    Shot("table", "report-phone", 390, 844, scale=1.5, clicks=("#changes .row",)),
    Shot("unchanged", "report-no-change"),
    Shot("yard", "report-forty-changes", keys=("j", "j", "j")),
)


def yard() -> tuple[Pair[PointCloud], Changes]:
    """The clouds of the yard, and what changed."""
    scene, changes = report_scenes.yard()
    return scene.clouds, changes


def detected(scene: report_scenes.Scene) -> tuple[Pair[PointCloud], Changes]:
    """The clouds of a scene, and what is detected."""
    return scene.clouds, report_scenes.detected(scene)


SCENES: dict[str, Callable[[], tuple[Pair[PointCloud], Changes]]] = {
    "hall": lambda: detected(report_scenes.hall()),
    "table": lambda: detected(report_scenes.table()),
    "unchanged": lambda: detected(report_scenes.table(changed=False)),
    "yard": yard,
}


def write_demo(folder: Path, _: Path) -> None:
    """Writes the demonstration."""
    gmmjax(["demo", "--out", str(folder), "--quiet"])


def write_batch(folder: Path, scans: Path) -> None:
    """Writes a batch run of simulated places, the last of which has a file that is cut off."""
    rows = [["name", "before", "after"]]
    for number, (family, seed, name) in enumerate(PLACES):
        pair = family_sources([family], [seed])[0].load()
        files = [f"{number}-{side}.ply" for side in ("before", "after")]
        for file, cloud in zip(files, (pair.before, pair.after), strict=True):
            write_ply(scans / file, cloud.points)
        rows.append([name, *files])
    (scans / "cut.ply").write_bytes((scans / files[1]).read_bytes()[:-999])
    rows.append([CUT_OFF, files[0], "cut.ply"])
    _write_rows(scans / "pairs.csv", rows)
    gmmjax(["batch", str(scans / "pairs.csv"), "--out", str(folder), "--restarts", "4", "--quiet"])
    index = folder / "index.html"
    index.write_text(index.read_text(encoding="utf-8").replace(str(scans), "/scans"), encoding="utf-8")


def write_series(folder: Path, scans: Path) -> None:
    """Writes the run of a series, one epoch of which cannot be read."""
    rows = [["name", "cloud"]]
    for number, (night, cloud) in enumerate(zip(NIGHTS, series(15, len(NIGHTS), things=8).clouds, strict=True)):
        write_ply(scans / f"{number}.ply", cloud.points)
        rows.append([night, f"{number}.ply"])
    (scans / f"{LOST_NIGHT}.ply").write_bytes(b"")
    _write_rows(scans / "epochs.csv", rows)
    words = ["batch", str(scans / "epochs.csv"), "--out", str(folder), "--series", "previous", "--restarts", "2"]
    gmmjax([*words, "--quiet"])


def _write_rows(path: Path, rows: list[list[str]]) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


RUNS = {"demo": write_demo, "Every night": write_batch, "Store room": write_series}


def write_made(folder: Path) -> None:
    """Writes the result that has the folder's name."""
    if folder.name in RUNS:
        with tempfile.TemporaryDirectory() as scans:
            RUNS[folder.name](folder, Path(scans))
        return
    clouds, changes = SCENES[folder.name]()
    write_result(folder, *clouds, changes)


def main() -> None:
    """Writes the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")
    parser.add_argument("--results", type=Path, help="folder to keep the results in; those that are there are used")
    parser.add_argument("--scenes", nargs="*", help="scenes to look at; default all")
    parser.add_argument("--no-clicks", action="store_true", help="take the pictures alone")
    options = parser.parse_args()
    if CHROMIUM is None or MISSING:
        parser.error(f"needs {', '.join(MISSING)}")
    shots = [shot for shot in SHOTS if not options.scenes or shot.scene in options.scenes]
    with tempfile.TemporaryDirectory() as temporary:
        results = options.results or Path(temporary)
        for name, page in {shot.scene: results / shot.scene / shot.page for shot in shots}.items():
            if not (results / name).exists():
                write_made(results / name)
            print(f"{name}: {page.stat().st_size / 1e6:.1f} MB")
            assert page.stat().st_size < LARGEST_PAGE
            if page.name == "report.html" and not options.no_clicks:
                subprocess.run(["node", CLICK_THROUGH, CHROMIUM, page, page.with_name("changes.json")], check=True)
        _take(shots, results, options.out, CHROMIUM)


def _take(shots: list[Shot], results: Path, out: Path, chromium: str) -> None:
    pictures: list[dict[str, Any]] = [
        {
            **shot._asdict(),
            "file": str((results / shot.scene / shot.page).resolve()),
            "picture": str(out.resolve() / f"{shot.name}.png"),
        }
        for shot in shots
    ]
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump(pictures, file)
        file.flush()
        subprocess.run(["node", HERE / "report_pictures.mjs", chromium, file.name], check=True)
    for one in pictures:
        _compress(Path(one["picture"]))


def _compress(path: Path) -> None:
    """256 colours: the most frequent ones as they are, among them those of the page, and the others rounded."""
    from PIL import Image

    image = Image.open(path).convert("RGB")
    counts = sorted(image.getcolors(image.width * image.height) or [], reverse=True)
    exact = [channel for _, color in counts[:96] for channel in color]  # type: ignore[union-attr]
    rounded = image.quantize(160, Image.Quantize.FASTOCTREE).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*exact, *(rounded or [])][:768])
    shown = image.quantize(palette=palette, dither=Image.Dither.NONE)
    # Pillow takes the first colour that is nearly the same: white would be a light grey.
    colors, pixels, entries = shown.getpalette(), np.asarray(image).reshape(-1, 3), np.asarray(shown).reshape(-1)
    for _, color in reversed(counts[:96]):
        entry = int(entries[np.argmax((pixels == color).all(axis=1))])
        colors[3 * entry : 3 * entry + 3] = color
    shown.putpalette(colors)
    shown.save(path, optimize=True)
    assert path.stat().st_size < LARGEST_PICTURE, f"{path} has {path.stat().st_size:,} bytes"


if __name__ == "__main__":
    main()
