"""What sensors see first, block by block."""

import numpy as np
import pytest

from gmmjax.changes import NearestReturnSettings, ScanVisibility, nearest_return_at
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair
from gmmjax.tiling.nearest_return import Looks, block_nearest_returns, nearest_returns_of_blocks
from gmmjax.tiling.records import BlockRecords, write_record
from tests.tiling.rooms import room
from tests.tiling.stores import store_of

STATION = np.array([1.0, 1.0, 1.2])


@pytest.fixture(scope="module")
def points():
    return Pair(room(0, box=False), room(1, box=True))


def found(points, looks, folder):
    """The points of all blocks, and the offset that they are relative to."""
    store = store_of(points, folder)
    assert len(store.tree) > 4
    records = BlockRecords(folder)
    for block in store.tree.blocks:
        records.add(write_record(folder, block.number, block_nearest_returns(store, block, looks(store.offset))))
    return nearest_returns_of_blocks(records), store.offset


def test_the_first_of_the_blocks_are_the_first_of_all(points, tmp_path):
    views = SensorViews.from_positions(points.after, [STATION])
    settings = NearestReturnSettings(cell=1.0)

    def looks(offset):
        return Pair(None, Looks.of(views.relative_to(offset), len(points.after), settings))

    (before, after), offset = found(points, looks, tmp_path)
    assert len(before) == 0 and len(after) < len(points.after) / 2
    left = (after + offset)[nearest_return_at(after + offset, views, settings.cell)]
    whole = points.after[nearest_return_at(points.after, views, settings.cell)]
    assert len(left) == len(whole)
    np.testing.assert_allclose(np.sort(left, axis=0), np.sort(whole, axis=0), atol=1e-9)
    survey = ScanVisibility.of(points.after[::20], views).with_line_of_sight(after + offset)
    assert 0 < len(survey.sighted.points) <= len(after)


def test_of_many_looks_some_points_are_taken(points, tmp_path):
    views = SensorViews.from_positions(points.after, [STATION])

    def looks(offset):
        few = NearestReturnSettings(cell=0.1, max_looks=len(points.after) // 3)
        return Pair(None, Looks.of(views.relative_to(offset), len(points.after), few))

    (_, after), _ = found(points, looks, tmp_path)
    assert len(after) < 0.34 * len(points.after)
