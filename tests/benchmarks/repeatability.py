"""How exactly results repeat when the same pair is given in another way: `python -m tests.benchmarks.repeatability`.

Each pair is detected as it is, and then with its rows permuted, in another unit, far from the origin, exchanged,
mirrored and rotated, both clouds alike. A cell of the table has the share of the labels that differ, after the changes
of both results were matched by the points that they share, and the greatest difference of a point's probability. "other
changes" is added where the changes are not as many of each kind; exchanging the clouds exchanges "appeared" and
"disappeared".

The real scans lie in the folder GMMJAX_DATA; without it the simulated pairs alone are measured.
"""

import argparse
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from gmmjax import Changes, read_cloud
from gmmjax.scenes import laboratory_scene
from tests.benchmarks.clouds import changed_pair
from tests.benchmarks.displaced_scenes import Scene
from tests.benchmarks.displacements import detected

REAL_PAIRS = ("split_milk_carton_removed", "mosd_test44_47", "split_room_sixpack_removed")
MIRRORED_KIND = {"appeared": "disappeared", "disappeared": "appeared", "moved": "moved"}
# Metres, 5,000 km.
SHIFT = np.array([3e6, 4e6, 0.0])
# About an axis that is none of the clouds' own.
ROTATION = Rotation.from_rotvec(np.radians(37) * np.array([1, 2, 3]) / np.sqrt(14)).as_matrix()


class Way(NamedTuple):
    """Another way to give a pair: what is done to the points of both clouds, whether they are exchanged."""

    name: str
    points: Callable[[np.ndarray], np.ndarray]
    exchanged: bool = False
    registration: str = "auto"


class Difference(NamedTuple):
    """Between two results for the same points."""

    labels: float
    probability: float
    same_changes: bool

    def __str__(self) -> str:
        labels = "0" if self.labels == 0 else f"{100 * self.labels:.2g} %"
        probability = "0" if self.probability == 0 else f"{self.probability:.1g}"
        return f"{labels}; {probability}" + ("" if self.same_changes else "; other changes")


WAYS = (
    Way("rows permuted", lambda points: points[order(points)]),
    Way("times 1,000", lambda points: 1000 * points),
    Way("shifted by 5,000 km", lambda points: points + SHIFT),
    Way("exchanged, not registered", lambda points: points, exchanged=True, registration="never"),
    Way("exchanged", lambda points: points, exchanged=True),
    Way("mirrored", lambda points: points * [-1, 1, 1]),
    Way("rotated by 37 degrees", lambda points: points @ ROTATION.T),
)


def pairs() -> Iterator[tuple[str, Callable[[], Scene]]]:
    """All pairs by name; each is made when it is its turn."""
    yield "Gaussians", lambda: Scene(*changed_pair(5000))
    yield "simulated room", room
    folder = os.environ.get("GMMJAX_DATA")
    for name in REAL_PAIRS if folder else ():
        pair = Path(folder or "") / "pairs" / name
        yield name, lambda pair=pair: Scene(*(read_cloud(pair / f"{time}.ply").points for time in ("before", "after")))


def room() -> Scene:
    """The simulated laboratory with its own misregistration, which is found and applied."""
    scene = laboratory_scene(jax.random.key(9300), appeared=1, disappeared=1)
    return Scene(scene.before, scene.after)


def order(points: np.ndarray) -> np.ndarray:
    """The permutation that a cloud of this size gets."""
    return np.random.default_rng(0).permutation(len(points))


def difference(reference: Changes, other: Changes, way: Way) -> Difference:
    sides = ("after", "before") if way.exchanged else ("before", "after")
    labels, probabilities = ([getattr(other, f"{name}_{side}") for side in sides] for name in ("labels", "probability"))
    if way.name == "rows permuted":
        labels, probabilities = ([_restored(values) for values in both] for both in (labels, probabilities))
    own = np.concatenate([reference.labels_before, reference.labels_after])
    own_probability = np.concatenate([reference.probability_before, reference.probability_after])
    renumbered = matching(own, np.concatenate(labels), len(reference.items), len(other.items))
    return Difference(
        labels=float(np.mean(own != renumbered)),
        probability=float(np.abs(own_probability - np.concatenate(probabilities)).max()),
        same_changes=_kinds(reference, False) == _kinds(other, way.exchanged),
    )


def matching(own: np.ndarray, other: np.ndarray, own_count: int, other_count: int) -> np.ndarray:
    """The other labels with the numbers of the changes that share their points; -2 where there is none."""
    both = (own >= 0) & (other >= 0)
    shared = np.zeros((own_count, other_count), int)
    np.add.at(shared, (own[both], other[both]), 1)
    rows, columns = linear_sum_assignment(-shared)
    numbers = np.full(other_count + 1, -2)
    numbers[columns] = np.where(shared[rows, columns] > 0, rows, -2)
    numbers[-1] = -1
    return numbers[other]


def _restored(permuted: np.ndarray) -> np.ndarray:
    values = np.empty_like(permuted)
    values[order(permuted)] = permuted
    return values


def _kinds(changes: Changes, exchanged: bool) -> list[str]:
    return sorted(MIRRORED_KIND[change.kind] if exchanged else change.kind for change in changes.items)


def measured(scene: Scene) -> Iterator[tuple[Way, Difference]]:
    references: dict[str, Changes] = {}
    for way in WAYS:
        if way.registration not in references:
            references[way.registration] = detected(*scene, way.registration).changes
        clouds = [way.points(points) for points in scene]
        found = detected(*(clouds[::-1] if way.exchanged else clouds), way.registration).changes
        yield way, difference(references[way.registration], found, way)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[""], help="pairs whose name contains one of these")
    arguments = parser.parse_args()
    table: dict[str, list[str]] = {way.name: [] for way in WAYS}
    names = []
    for name, make in pairs():
        if not any(part in name for part in arguments.only):
            continue
        scene = make()
        names.append(f"{name}, {len(scene.before):,} and {len(scene.after):,} points")
        for way, found in measured(scene):
            table[way.name].append(str(found))
            print(f"{names[-1]}, {way.name}: {found}", flush=True)
    print("", "| both clouds | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|", sep="\n")
    for way_name, cells in table.items():
        print("| " + " | ".join([way_name, *cells]) + " |")


if __name__ == "__main__":
    main()
