"""Whether displaced scans give the same changes: `python -m tests.benchmarks.displacements --tries 500`.

Each scene is detected as it is, and then with the after cloud displaced by 0 to 50 cm (a third of the extent at most)
in any direction and rotated by 0 to 30 degrees about any axis, through the origin and the cloud's centre in turn. With
`--shift` or `--rotation` these displacements are tried in place of random ones: translations along x, and rotations
about each of the axes x, y and z through the origin. A try is right when the changes are the same (equally many of
each kind, and each shares half of its points with one of the changes found without the displacement) and the transform
takes the displacement back to a quarter of the points' spacing and 0.2 degrees; it is warned of when a warning was
given that was not given without the displacement.

The simulated scenes are those of this folder and the laboratory; real scans lie in the folder GMMJAX_DATA.
"""

import argparse
import collections
import csv
import os
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax import Changes, DetectionConfig, detect_changes, read_cloud
from gmmjax.errors import InputWarning
from gmmjax.geometry.rigid import rigid_transform, rotation_about, transformed
from gmmjax.scenes import laboratory_scene
from tests.benchmarks.displaced_scenes import Scene, hall, table

GREATEST_SHIFT, GREATEST_ANGLE = 0.5, 30.0
FIRST_SEED = 8900


class Detected(NamedTuple):
    """What was found, the warnings, and the CPU time."""

    changes: Changes
    warnings: list[str]
    seconds: float


class Displacement(NamedTuple):
    """A rigid transform [4, 4] of the after cloud, the length of its translation (metres) and its angle (degrees)."""

    transform: np.ndarray
    shift: float
    angle: float


class Try(NamedTuple):
    """One displaced detection beside the one without displacement."""

    scene: str
    shift: float
    angle: float
    changes: int
    same_changes: bool
    spacings_off: float
    degrees_off: float
    warned: bool
    confidence: float
    seconds: float

    @property
    def recovered(self) -> bool:
        return self.spacings_off <= 0.25 and self.degrees_off <= 0.2


def scenes(simulated: int) -> Iterator[tuple[str, Callable[[], Scene]]]:
    """All scenes by name; each is made when it is its turn."""
    folder = Path(os.environ.get("GMMJAX_DATA", "")) / "pairs"
    for pair in sorted(folder.iterdir()) if os.environ.get("GMMJAX_DATA") and folder.is_dir() else []:
        yield pair.name, lambda pair=pair: Scene(*(read_cloud(pair / f"{t}.ply").points for t in ("before", "after")))
    for seed in range(FIRST_SEED, FIRST_SEED + simulated):
        yield f"table {seed}", lambda seed=seed: table(seed)
        yield f"hall {seed}", lambda seed=seed: hall(seed)
        for survey, level in (("panorama", "normal"), ("panorama", "hard"), ("frame", "normal")):
            yield f"room {survey} {level} {seed}", lambda *given, s=survey, v=level, seed=seed: room(seed, s, v)


def room(seed: int, survey: str, level: str) -> Scene:
    """The laboratory, without its own misregistration."""
    scene = laboratory_scene(jax.random.key(seed), appeared=1, disappeared=1, survey=survey, level=level)
    return Scene(scene.before, transformed(scene.after, np.linalg.inv(scene.misregistration)))


def random_displacement(random: np.random.Generator, scene: Scene, about_centre: bool) -> Displacement:
    most = min(GREATEST_SHIFT, np.ptp(scene.before, axis=0).max() / 3)
    axis, direction = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
    shift, angle = random.uniform(0, most), random.uniform(0, GREATEST_ANGLE)
    rotation = Rotation.from_rotvec(np.radians(angle) * axis).as_matrix()
    centre = scene.after.mean(axis=0) if about_centre else np.zeros(3)
    return Displacement(rotation_about(rotation, centre, centre + shift * direction), shift, angle)


def given_displacements(shifts: list[float], angles: list[float]) -> list[Displacement]:
    """Translations along x in metres, then rotations in degrees about x, y and z through the origin."""
    displacements = []
    for shift in shifts:
        displacements.append(Displacement(rigid_transform(translation=np.array([shift, 0.0, 0.0])), shift, 0.0))
    for angle in angles:
        for axis in np.eye(3):
            rotation = Rotation.from_rotvec(np.radians(angle) * axis).as_matrix()
            displacements.append(Displacement(rigid_transform(rotation), 0.0, angle))
    return displacements


def detected(before: np.ndarray, after: np.ndarray, mode: str) -> Detected:
    start = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        changes = detect_changes(before, after, config=DetectionConfig(registration=mode))
    return Detected(changes, [str(warning.message) for warning in caught], time.process_time() - start)


def same_changes(one: Changes, other: Changes) -> bool:
    """Equally many of each kind, and each shares half of its points with one of the other's."""
    kinds = [collections.Counter(change.kind for change in changes.items) for changes in (one, other)]
    return kinds[0] == kinds[1] and all(
        all(_shared(first == label, second) >= 0.5 for label in np.unique(first[first >= 0]))
        for first, second in ((one.labels_before, other.labels_before), (one.labels_after, other.labels_after))
    )


def _shared(own: np.ndarray, labels: np.ndarray) -> float:
    """Intersection over union of a change's points and those of the change that shares most of them."""
    counts = np.bincount(labels[own & (labels >= 0)], minlength=1)
    best = int(np.argmax(counts))
    return float(counts[best] / (own | (labels == best)).sum())


def tried(name: str, scene: Scene, reference: Detected, displacement: Displacement) -> Try:
    found = detected(scene.before, transformed(scene.after, displacement.transform), "auto")
    undisplaced = reference.changes.registration.transform
    left = found.changes.registration.transform @ displacement.transform
    points = scene.after[:: max(len(scene.after) // 2000, 1)]
    distances = np.linalg.norm(transformed(points, left) - transformed(points, undisplaced), axis=1)
    rotation = Rotation.from_matrix(left[:3, :3] @ undisplaced[:3, :3].T)
    return Try(
        scene=name,
        shift=displacement.shift,
        angle=displacement.angle,
        changes=len(found.changes.items),
        same_changes=same_changes(reference.changes, found.changes),
        spacings_off=float(distances.mean() / found.changes.diagnostics["spacing"]),
        degrees_off=float(np.degrees(rotation.magnitude())),
        warned=len(found.warnings) > len(reference.warnings),
        confidence=found.changes.registration.confidence,
        seconds=found.seconds,
    )


def main() -> None:
    arguments = parsed_arguments()
    chosen = [scene for scene in scenes(arguments.simulated) if any(part in scene[0] for part in arguments.only)]
    if not chosen:
        raise SystemExit(f"no scene's name contains {' or '.join(arguments.only)}; GMMJAX_DATA names real scans")
    random = np.random.default_rng(arguments.seed)
    given = given_displacements(arguments.shift, arguments.rotation)
    shares = np.bincount(np.arange(arguments.tries) % len(chosen), minlength=len(chosen))
    rows: list[Try] = []
    print(_ROW_HEADER if given else _LINE_HEADER, flush=True)
    for (name, make), count in zip(chosen, shares, strict=True):
        scene = make()
        # The transform that the scans themselves ask for is what the displaced ones must come back to.
        reference = detected(scene.before, scene.after, "always")
        random_ones = (random_displacement(random, scene, about_centre=number % 2 == 0) for number in range(count))
        own = []
        for displacement in given or random_ones:
            own.append(tried(name, scene, reference, displacement))
            if given:
                print(_row(own[-1], len(reference.changes.items)), flush=True)
        rows += own
        if not given:
            print(_line(name, own), flush=True)
        if arguments.csv:
            with arguments.csv.open("w", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(Try._fields)
                writer.writerows(rows)
    print(*(["", _LINE_HEADER] if given else []), _line("all", rows), sep="\n")


def parsed_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tries", type=int, default=500, help="random displacements, of all scenes together")
    parser.add_argument("--simulated", type=int, default=4, help="seeds of each kind of simulated scene")
    parser.add_argument("--seed", type=int, default=0, help="of the random displacements")
    parser.add_argument("--shift", type=float, nargs="+", default=[], help="metres along x, in place of random ones")
    parser.add_argument("--rotation", type=float, nargs="+", default=[], help="degrees, in place of random ones")
    parser.add_argument("--only", nargs="+", default=[""], help="scenes whose name contains one of these")
    parser.add_argument("--csv", type=Path, help="where a row for each try is written, as it is done")
    return parser.parse_args()


_LINE_HEADER = f"{'scene':34s} tries  same changes  recovered  neither right nor warned  CPU s"
_ROW_HEADER = f"{'scene':34s} shift m  rotation  changes  undisplaced  same  spacings off  degrees off  warned  CPU s"


def _row(one: Try, undisplaced: int) -> str:
    same, warned = ("yes" if value else "no" for value in (one.same_changes, one.warned))
    return (
        f"{one.scene:34s} {one.shift:7g}  {one.angle:8g}  {one.changes:7d}  {undisplaced:11d}  {same:>4s}"
        f"  {one.spacings_off:12.3f}  {one.degrees_off:11.3f}  {warned:>6s}  {one.seconds:5.2f}"
    )


def _line(name: str, rows: list[Try]) -> str:
    same, recovered = (sum(getattr(row, field) for row in rows) for field in ("same_changes", "recovered"))
    silent = sum(not row.warned and not (row.same_changes and row.recovered) for row in rows)
    seconds = np.median([row.seconds for row in rows]) if rows else 0.0
    return f"{name:34s} {len(rows):5d}  {same:12d}  {recovered:9d}  {silent:24d}  {seconds:5.2f}"


if __name__ == "__main__":
    main()
