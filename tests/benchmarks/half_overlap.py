"""Whether surveys that share a half are registered: `python -m tests.benchmarks.half_overlap --seeds 4`.

Scenes of the families that the verdict is learned from, as they are and cut along their longest axis, so that each
survey covers two thirds and both share one; as they are given, and displaced by up to an eighth of their extent and 30
degrees. A registration is right when it takes the displacement back to three spacings of its voxels. For each rule the
number of right ones: the highest score, as for surveys of one place, and the given frame unless another transform is
more consistent, with places that the other survey covers as those within `covered_spacings`.
"""

import argparse
import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.changes.align.surface_fit import FitScoreSettings
from gmmjax.changes.align.surfaces import SurfaceRegistrationSettings, rough_registration
from gmmjax.changes.prepare.resolution import ResolutionSettings, working_pair
from gmmjax.geometry import rotation_about, transformed
from gmmjax.learning import LEARNED_FROM, training_sources
from gmmjax.pair import Pair

SHARE = 0.66
FEWEST = 3000


class Case(NamedTuple):
    """Two clouds, whether they are cut, and the displacement of the after cloud [4, 4]."""

    clouds: Pair[np.ndarray]
    cut: bool
    displacement: np.ndarray

    @property
    def name(self) -> str:
        displaced = (self.displacement != np.eye(4)).any()
        return f"{'a third' if self.cut else 'whole'}, {'displaced' if displaced else 'as given'}"


def rules(covered: list[float]) -> dict[str, SurfaceRegistrationSettings]:
    """The settings of each rule."""
    standard = SurfaceRegistrationSettings()
    found = {"highest score": dataclasses.replace(standard, more_consistent=-1.0)}
    for spacings in covered:
        score = FitScoreSettings(covered_spacings=spacings)
        found[f"more consistent, covered within {spacings:g}"] = dataclasses.replace(standard, score=score)
    return found


def cases(family: str, seed: int) -> Iterator[Case]:
    """A scene whole and cut, as given and displaced twice."""
    (source,) = training_sources(family, [seed])
    pair = source.load()
    whole = Pair(pair.before.points, pair.after.points)
    for cut in (False, True):
        clouds = _cut(whole) if cut else whole
        if min(map(len, clouds)) < FEWEST:
            continue
        for number in range(3):
            displacement = np.eye(4) if number == 0 else _displacement(clouds.after, 100 * seed + number)
            yield Case(Pair(clouds.before, transformed(clouds.after, displacement)), cut, displacement)


def right(case: Case, settings: SurfaceRegistrationSettings) -> bool:
    """Whether the registration takes the displacement back."""
    spacing = working_pair(case.clouds, settings=ResolutionSettings(voxels=settings.voxels)).spacing
    found = rough_registration(case.clouds, settings).transform @ case.displacement
    given = transformed(case.clouds.after, np.linalg.inv(case.displacement))
    return float(np.sqrt(((transformed(given, found) - given) ** 2).sum(axis=1).mean())) <= 3 * spacing


def _cut(clouds: Pair[np.ndarray]) -> Pair[np.ndarray]:
    axis = int(np.ptp(clouds.before, axis=0).argmax())
    lower, upper = np.quantile(clouds.before[:, axis], [0.01, 0.99])
    first, last = lower + SHARE * (upper - lower), upper - SHARE * (upper - lower)
    return Pair(clouds.before[clouds.before[:, axis] < first], clouds.after[clouds.after[:, axis] > last])


def _displacement(points: np.ndarray, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    axis, way = (own / np.linalg.norm(own) for own in random.standard_normal((2, 3)))
    rotation = Rotation.from_rotvec(np.radians(random.uniform(3, 30)) * axis).as_matrix()
    shift = random.uniform(0.01, 0.12) * np.linalg.norm(np.ptp(points, axis=0)) * way
    return rotation_about(rotation, points.mean(axis=0), points.mean(axis=0) + shift)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", nargs="+", default=list(LEARNED_FROM), choices=LEARNED_FROM)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first-seed", type=int, default=2000)
    parser.add_argument("--covered", type=float, nargs="+", default=[FitScoreSettings().covered_spacings])
    arguments = parser.parse_args()
    by_name = rules(arguments.covered)
    results: dict[str, dict[str, list[bool]]] = {}
    for family in arguments.families:
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
            for case in cases(family, seed):
                for name, settings in by_name.items():
                    results.setdefault(case.name, {}).setdefault(name, []).append(right(case, settings))
    print(f"| shared, frame | {' | '.join(by_name)} |\n|{'---|' * (len(by_name) + 1)}")
    for name, found in results.items():
        print(f"| {name} | {' | '.join(f'{sum(own)} of {len(own)}' for own in found.values())} |")


if __name__ == "__main__":
    main()
