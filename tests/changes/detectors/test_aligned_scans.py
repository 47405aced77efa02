import numpy as np
import pytest

from gmmjax.changes import LocalResolutionSettings, ResolutionSettings
from gmmjax.changes.align.alignment import aligned
from gmmjax.changes.detectors.aligned_scans import refined
from gmmjax.pair import Pair

RESOLUTION = ResolutionSettings(voxels=4000)


def floors(count):
    """A floor with a step, surveyed twice, in points that lie at random."""

    def floor(seed):
        random = np.random.default_rng(seed)
        places = random.uniform(0, 4, (count, 2))
        return np.column_stack([places, 0.5 * (places[:, 0] > 2) + 0.002 * random.standard_normal(count)])

    return aligned(Pair(floor(0), floor(1)), "never", None, resolution=RESOLUTION)


def test_scans_of_few_points_more_than_voxels_stay_at_one_resolution():
    assert refined(floors(6000), LocalResolutionSettings()) is None


@pytest.mark.parametrize("halvings", [0, 6])
def test_dense_scans_are_compared_in_smaller_voxels(halvings):
    pair = floors(40_000)
    finer = refined(pair, LocalResolutionSettings(halvings=halvings))
    assert (finer is None) == (halvings == 0)
    if finer is not None:
        assert min(cloud.sizes.min() for cloud in finer.working.clouds) == pair.working.voxel_size / 2
        assert len(finer.surfaces.before) == len(finer.working.clouds.before.points) > len(pair.surfaces.before)
