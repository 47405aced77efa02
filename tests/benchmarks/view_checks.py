"""Whether views are told from those of another place: `python -m tests.benchmarks.view_checks --seeds 24`.

Surveys of the families that the verdict is learned from, in as many voxels as a registration takes: with their own
views, and with views that are off by half the width of the cloud along its two longest axes. `--dense` scans depots
with up to four million rays.
"""

import argparse
import zlib
from collections.abc import Iterator

import numpy as np

from gmmjax.changes.evidence.survey import Survey
from gmmjax.changes.evidence.view_checks import check_views
from gmmjax.changes.prepare.resolution import ResolutionSettings
from gmmjax.clouds import SensorViews, voxel_grid, voxel_size_for
from gmmjax.errors import InputError
from gmmjax.geometry import rigid_transform
from gmmjax.learning import LEARNED_FROM, training_sources
from gmmjax.scenes.families.halls import depots
from gmmjax.scenes.families.scanners import TripodSurveys


def surveys(family: str, seed: int) -> Iterator[tuple[np.ndarray, SensorViews]]:
    """Both surveys of a scene of a family."""
    (source,) = training_sources(family, [seed])
    pair = source.load()
    for cloud in (pair.before, pair.after):
        assert cloud.views is not None
        yield cloud.points, cloud.views


def dense_surveys(seed: int) -> Iterator[tuple[np.ndarray, SensorViews]]:
    """Both surveys of a depot of half a million to two million points."""
    rays, most = (1_500_000, 4_000_000), (500_000, 2_000_000)
    dense = TripodSurveys(rays, most, 100_000, hidden_by=0.06, highest=(30.0, 80.0), fused=0.4)
    scene = depots(np.random.default_rng([seed, zlib.crc32(b"dense_depots")]), dense)
    yield from zip(scene.clouds, scene.views, strict=True)


def refused(points: np.ndarray, views: SensorViews) -> bool:
    """Whether the views contradict the survey, or see none of it."""
    voxels = ResolutionSettings().voxels
    reduced = points if len(points) <= voxels else voxel_grid(points, voxel_size_for(points, voxels)).points
    try:
        return check_views("views", Survey.of(reduced, views), points=points) is not None
    except InputError:
        return True


def elsewhere(points: np.ndarray, views: SensorViews) -> Iterator[SensorViews]:
    """The views off by half the width of the cloud, along its two longest axes."""
    width = np.ptp(points, axis=0)
    for axis in np.argsort(width)[-2:]:
        yield views.moved(rigid_transform(translation=np.eye(3)[axis] * width[axis] / 2))


def main() -> None:
    """Prints a row for each family."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--families", nargs="+", default=list(LEARNED_FROM))
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--dense", action="store_true", help="depots of up to two million points, in place of families")
    arguments = parser.parse_args()
    print("| family | surveys | own views refused | views off by half the width refused |\n|---|---|---|---|")
    for family in ["dense depots"] if arguments.dense else arguments.families:
        own, wrong, count = 0, 0, 0
        for seed in range(arguments.seeds):
            for points, views in dense_surveys(seed) if arguments.dense else surveys(family, seed):
                count += 1
                own += refused(points, views)
                wrong += sum(refused(points, moved) for moved in elsewhere(points, views))
        print(f"| {family} | {count} | {own} | {wrong} of {2 * count} |", flush=True)


if __name__ == "__main__":
    main()
