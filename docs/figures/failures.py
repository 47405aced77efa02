"""Detections that go wrong, and what helps: the pictures and the terminal's output in `docs/when-it-goes-wrong.md`.

`python docs/figures/failures.py [NAME ...]` runs all cases, or those that are named, on simulated scans.
"""

import contextlib
import dataclasses
import io
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from drawing import overlaid, saved
from jaxtyping import Float, UInt8
from matplotlib import pyplot
from matplotlib.axes import Axes
from scipy.spatial.transform import Rotation

from gmmjax import Changes, read_cloud
from gmmjax.cli import main
from gmmjax.clouds import write_ply, write_views
from gmmjax.geometry import rigid_transform, transformed
from gmmjax.pair import Pair
from gmmjax.plotting import plot_changes
from gmmjax.reporting.truth_rows import false_labels, truth_rows
from gmmjax.scenes import StorehouseSettings, SurveyedScene, family_scene, storehouse

PAGE = Path(__file__).parents[1] / "when-it-goes-wrong.md"
VIEWS = ("--views-before", "before_views.json", "--views-after", "after_views.json")
SMALL = StorehouseSettings(points=25_000, rays=35_000)
Draw = Callable[[Axes, "Outcome"], None]


@dataclasses.dataclass(frozen=True, eq=False)
class Scans:
    """A simulated pair.

    Attributes:
        scene: with the truth.
        colors: of the points; None: without.
        shown: of the before and after cloud, what a user has of it: rows, and a change of the coordinates.
    """

    scene: SurveyedScene
    colors: Pair[UInt8[np.ndarray, "n 3"]] | None = None
    shown: Pair[Callable[[Float[np.ndarray, "n 3"]], tuple[Float[np.ndarray, "m 3"], np.ndarray]] | None] = Pair(
        None, None
    )

    def write(self, folder: Path) -> None:
        """As files that `gmmjax detect` reads."""
        colors = self.colors or Pair(None, None)
        for side, points, own, views, show in zip(
            ("before", "after"), self.scene.clouds, colors, self.scene.views, self.shown, strict=True
        ):
            kept, rows = show(points) if show else (points, np.arange(len(points)))
            write_ply(folder / f"{side}.ply", kept, colors=None if own is None else own[rows])
            write_views(folder / f"{side}_views.json", views)


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """A detection.

    Attributes:
        scans: that it is given.
        options: of the command.
        title: of its picture.
        draw: its picture; None: the changes, from above.
    """

    scans: Callable[[], Scans]
    title: str
    options: tuple[str, ...] = ()
    draw: Draw | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a run: the terminal's output, the scans as they were given, and the changes, where there are any."""

    said: str
    clouds: Pair
    changes: Changes | None


def detected(run: Run, folder: Path) -> Outcome:
    """Runs the command in a folder."""
    run.scans().write(folder)
    words = ["before.ply", "after.ply", "--out", "result", *run.options]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(["detect", *words])
        clouds = Pair(read_cloud("before.ply"), read_cloud("after.ply"))
    answer = out.getvalue().split("\nResults in")[0]
    said = f"$ gmmjax detect {' '.join(words)}\n{wrapped(err.getvalue())}{answer}".rstrip()
    return Outcome(said, clouds, Changes.load(folder / "result") if status == 0 else None)


def wrapped(text: str, width: int = 80) -> str:
    """The lines as a terminal of this width breaks them, at words."""
    import textwrap

    return "".join(textwrap.fill(line, width) + "\n" for line in text.splitlines())


def changes_from_above(ax: Axes, outcome: Outcome) -> None:
    """The changes over both clouds."""
    assert outcome.changes is not None
    plot_changes(outcome.changes, *outcome.clouds, direction="above", ax=ax, legend=False)


def as_registered(ax: Axes, outcome: Outcome) -> None:
    """Both clouds from above, as the registration laid them."""
    assert outcome.changes is not None
    before, after = outcome.clouds
    overlaid(Pair(before.points, transformed(after.points, outcome.changes.registration.transform)), ax)


def as_given(ax: Axes, outcome: Outcome) -> None:
    """Both clouds from above, with the coordinates of their files."""
    overlaid(outcome.clouds.map(lambda cloud: cloud.points), ax, size=2.0)


def colored(settings: StorehouseSettings, shown: Pair = Pair(None, None)) -> Callable[[], Scans]:
    """Makes scans of the storehouse."""

    def scans() -> Scans:
        made = storehouse(0, settings)
        return Scans(made.scene, made.colors, shown)

    return scans


def half(sign: float, limit: float) -> Callable:
    """The part of the storehouse on one side of a limit along its length."""

    def show(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rows = np.flatnonzero(sign * points[:, 0] > limit)
        return points[rows], rows

    return show


def displaced(degrees: float, shift: Sequence[float]) -> Callable:
    """All of it, turned about the vertical and shifted."""
    motion = rigid_transform(Rotation.from_euler("z", degrees, degrees=True).as_matrix(), np.array(shift, float))
    return lambda points: (transformed(points, motion), np.arange(len(points)))


def scaled(factor: float) -> Callable:
    """All of it, in another unit."""
    return lambda points: (factor * points, np.arange(len(points)))


def slope() -> Scans:
    """A slope with rocks and bushes from two stations, which each see what the other does not."""
    return Scans(family_scene("terrain", 1))


ONE_STATION = dataclasses.replace(SMALL, rays=60_000, stations=Pair(((-2.9, -0.7),), ((3.2, -0.8),)))
ONCE_EACH = dataclasses.replace(ONE_STATION, points=25_000)

CASES: dict[str, tuple[Run, Run]] = {
    "poses": (
        Run(colored(ONCE_EACH), "without poses"),
        Run(colored(ONCE_EACH), "with poses", VIEWS),
    ),
    "overlap": (
        Run(colored(SMALL, Pair(half(-1, -0.5), half(1, -0.5))), "one metre in common", draw=as_registered),
        Run(colored(SMALL, Pair(half(-1, -2.5), half(1, -2.5))), "five metres in common"),
    ),
    "rotation": (
        Run(colored(SMALL, Pair(None, displaced(120, (2, 1, 0)))), "turned by 120 degrees", draw=as_registered),
        Run(colored(SMALL, Pair(None, displaced(8, (0.3, 0.2, 0)))), "roughly aligned first"),
    ),
    "units": (
        Run(colored(SMALL, Pair(None, scaled(1000))), "metres and millimetres", draw=as_given),
        Run(colored(SMALL), "both in metres"),
    ),
    "voxel": (
        Run(colored(StorehouseSettings()), "voxels of 30 cm", ("--voxel-size", "0.3")),
        Run(colored(StorehouseSettings()), "without --voxel-size"),
    ),
    "doubtful": (
        Run(slope, "without poses"),
        Run(slope, "with poses", VIEWS),
    ),
}


def put(name: str, text: str) -> None:
    """Replaces what stands between the marks of a case in the page, if it has any."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    page = PAGE.read_text(encoding="utf-8")
    if begin not in page:
        return
    before, rest = page.split(begin)
    PAGE.write_text(f"{before}{begin}\n\n```text\n{text}\n```\n\n{end}{rest.split(end)[1]}", encoding="utf-8")


def compared(run: Run, outcome: Outcome) -> str:
    """How what was found compares with the truth."""
    if outcome.changes is None:
        return "no result"
    scans = run.scans()
    if any(scans.shown) and any(show is not None for show in scans.shown):
        return f"{len(outcome.changes)} changes"
    rows = truth_rows(scans.scene, outcome.changes)
    found = sum(bool(row.labels) for row in rows)
    return f"{found} of {len(rows)} found, {len(false_labels(scans.scene, outcome.changes))} false"


def run_case(name: str) -> list[Outcome]:
    """Both runs of a case."""
    outcomes = []
    for run in CASES[name]:
        with tempfile.TemporaryDirectory() as folder:
            outcomes.append(detected(run, Path(folder)))
    return outcomes


def make(name: str) -> None:
    """Runs a case, and writes its picture and what the terminal said."""
    outcomes = run_case(name)
    figure, panels = pyplot.subplots(1, 2, figsize=(9.5, 4.0), layout="constrained")
    for ax, run, outcome in zip(panels, CASES[name], outcomes, strict=True):
        (run.draw or changes_from_above)(ax, outcome)
        ax.set_title(run.title)
        print(f"{name}, {run.title}: {compared(run, outcome)}")
    saved(figure, f"wrong-{name}.png", dpi=100, colors=96)
    put(name, outcomes[0].said)
    put(f"{name}, repaired", outcomes[1].said)


if __name__ == "__main__":
    os.environ["COLUMNS"] = "80"
    for case in sys.argv[1:] or CASES:
        make(case)
