"""The pictures of the report in the documentation: `python -m tests.benchmarks.report_pictures --out docs/images`.

It makes the scenes, detects their changes, clicks through every report and takes its pictures. It needs node, Chromium,
and `npm ci` in `gmmjax/reporting/viewer`.
"""

import argparse
import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from gmmjax.changes import Changes
from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from gmmjax.reporting import write_result
from tests.benchmarks import report_scenes

HERE = Path(__file__).parent
CLICK_THROUGH = HERE.parent / "reporting" / "click_through.mjs"
# A page of two million points, and a picture for the documentation, bytes.
LARGEST_PAGE, LARGEST_PICTURE = 12_000_000, 300_000


class Shot(NamedTuple):
    """A picture of a report.

    Attributes:
        scene: whose report it is.
        name: of the picture.
        width: of the window, pixels.
        height: of the window, pixels.
        dark: whether in dark colours.
        scale: pixels of the picture for one of the window.
        keys: that are pressed first.
        clicks: on the first element that each selector finds, after the keys.
    """

    scene: str
    name: str
    width: int = 1440
    height: int = 900
    dark: bool = False
    scale: float = 1.0
    keys: tuple[str, ...] = ()
    clicks: tuple[str, ...] = ()


SHOTS = (
    Shot("hall", "report-hall"),
    Shot("hall", "report-hall-change", keys=("j", "j")),
    Shot("table", "report-table", clicks=("#changes li.moved .row",)),
    Shot("table", "report-table-dark", dark=True, keys=("c",)),
    Shot("table", "report-phone", 390, 844, scale=1.5, clicks=("#changes .row",)),
    Shot("unchanged", "report-no-change"),
    Shot("yard", "report-forty-changes", keys=("j", "j", "j")),
)


def made(name: str) -> tuple[Pair[PointCloud], Changes]:
    """The clouds of a scene, and what changed."""
    if name == "yard":
        scene, changes = report_scenes.yard()
        return scene.clouds, changes
    scenes: dict[str, Callable[[], report_scenes.Scene]] = {
        "hall": report_scenes.hall,
        "table": report_scenes.table,
        "unchanged": lambda: report_scenes.table(changed=False),
    }
    scene = scenes[name]()
    return scene.clouds, report_scenes.detected(scene)


def main() -> None:
    """Writes the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")
    parser.add_argument("--results", type=Path, help="folder to keep the results in; those that are there are used")
    parser.add_argument("--scenes", nargs="*", help="scenes to look at; default all")
    parser.add_argument("--no-clicks", action="store_true", help="take the pictures alone")
    options = parser.parse_args()
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        parser.error("chromium is not on the PATH")
    shots = [shot for shot in SHOTS if not options.scenes or shot.scene in options.scenes]
    with tempfile.TemporaryDirectory() as temporary:
        results = options.results or Path(temporary)
        for name in dict.fromkeys(shot.scene for shot in shots):
            folder = results / name
            if not folder.exists():
                clouds, changes = made(name)
                write_result(folder, *clouds, changes)
            size = (folder / "report.html").stat().st_size
            print(f"{name}: {size / 1e6:.1f} MB")
            assert size < LARGEST_PAGE
            if not options.no_clicks:
                files = folder / "report.html", folder / "changes.json"
                subprocess.run(["node", CLICK_THROUGH, chromium, *files], check=True)
        _take(shots, results, options.out, chromium)


def _take(shots: list[Shot], results: Path, out: Path, chromium: str) -> None:
    pictures: list[dict[str, Any]] = [
        {
            **shot._asdict(),
            "report": str((results / shot.scene / "report.html").resolve()),
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
    image.quantize(palette=palette, dither=Image.Dither.NONE).save(path, optimize=True)
    assert path.stat().st_size < LARGEST_PICTURE, f"{path} has {path.stat().st_size:,} bytes"


if __name__ == "__main__":
    main()
