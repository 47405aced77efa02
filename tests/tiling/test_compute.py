"""Blocks on many workers: the same results whatever the tiles and workers are, and whatever happens to them."""

import errno
import os
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.clouds import BlockSettings, PlacedClouds, tree_of
from gmmjax.errors import ComputationError, InputError
from gmmjax.pair import Pair
from gmmjax.tiling import (
    RowColumns,
    TileSettings,
    Workers,
    columns_of,
    compute_blocks,
    temporary_block_store,
    tiles_of,
)
from tests.clouds.made_clouds import ArrayCloud, ChunkedArray, MemoryBlockStore, slope
from tests.tiling.tasks import fails, heights, heights_after_death, interrupted, process

SMALL = BlockSettings(voxels=4, covered=0.05, least_points=8, cells=4, cell_points=1.0, most_points=300.0)
MISSING = {"height": np.float64(np.nan), "block": np.int32(-1)}
PLACE = np.array([5_432_100.0, 5_678_900.0, 400.0])


def placed(size=1_000_000, count=3_000):
    points = Pair(slope(count, 0, lower=PLACE), slope(count * 2 // 3, 1, lower=PLACE, change=0.3))
    return PlacedClouds(points.map(lambda own: ChunkedArray(own, size)))


@pytest.fixture(scope="module")
def tree():
    found = tree_of(placed(), SMALL)
    assert len(found) > 40
    return found


def computed(store, task=heights, arguments=(0.3,), **where):
    """All that a computation gives, as bytes."""
    columns = columns_of(store, MISSING)
    records = compute_blocks(store, task, arguments, columns=columns, **where)
    values = [(number, *(own.tobytes() for own in result.values.values())) for number, result in records]
    return values, [own.column(name).tobytes() for own in columns for name in own.names]


@pytest.fixture(scope="module")
def expected(tree, tmp_path_factory):
    with (
        temporary_block_store(placed(), tree, tmp_path_factory.mktemp("expected")) as store,
        ThreadPoolExecutor(1) as one,
    ):
        return computed(store, workers=Workers(executor=one))


@settings(max_examples=8)
@given(
    size=st.integers(150, 3_000),
    tile=st.sampled_from([None, 2.0, 5.0, 20.0]),
    threads=st.integers(1, 3),
    points=st.sampled_from([0.0, 500.0, np.inf]),
)
def test_tiles_workers_and_chunks_change_nothing(tree, expected, tmp_path_factory, size, tile, threads, points):
    folder = tmp_path_factory.mktemp("tiles")
    with temporary_block_store(placed(size), tree, folder) as store, ThreadPoolExecutor(threads) as executor:
        workers, sizes = Workers(executor=executor, capacity=4), TileSettings(points=points, spacings=0.0)
        assert computed(store, tile_size=tile, workers=workers, settings=sizes) == expected
    assert list(folder.iterdir()) == []


def test_clouds_in_memory_give_the_same(tree, expected):
    store = MemoryBlockStore(placed(), tree)
    found = [(block.number, result) for block in store.blocks for result in [heights(store, block, 0.3)]]
    assert [(number, *(own.tobytes() for own in result.values.values())) for number, result in found] == expected[0]


def test_values_come_to_their_rows(tree, tmp_path):
    clouds = placed(700)
    with temporary_block_store(clouds, tree, tmp_path) as store, ThreadPoolExecutor(2) as executor:
        columns = columns_of(store, MISSING)
        compute_blocks(store, heights, (0.1,), columns=columns, workers=Workers(executor=executor))
        for own, cloud in zip(columns, clouds.clouds, strict=True):
            relative = cloud.points - store.offset
            np.testing.assert_array_equal(own.column("height"), relative[:, 2])
            np.testing.assert_array_equal(own.column("block"), tree.blocks_of(relative))
            slices = list(own.slices(900))
            np.testing.assert_array_equal(np.concatenate([part["height"] for part in slices]), relative[:, 2])
            assert {len(part["height"]) for part in slices[:-1]} == {900}


def test_rows_that_are_filled_by_nobody_are_missing(tmp_path):
    columns = RowColumns(tmp_path / "columns", 5, MISSING)
    columns.fill(np.array([3, 1]), {"block": np.array([7, 8], np.int32)})
    assert columns.column("block").tolist() == [-1, 8, -1, 7, -1]
    assert np.isnan(columns.column("height")).all()


def test_a_killed_worker(tree, expected, tmp_path):
    with temporary_block_store(placed(), tree, tmp_path) as store:
        mark, told = tmp_path / "killed", []
        found = computed(
            store,
            heights_after_death,
            (0.3, mark),
            workers=Workers(2),
            settings=TileSettings(points=500.0),
            progress=lambda message, share: told.append(share),
        )
        assert mark.exists()
        assert found == expected
    assert told == sorted(told)
    assert told[-1] == 1
    assert [path.name for path in tmp_path.iterdir()] == ["killed"]


class _Deadly(ThreadPoolExecutor):
    """An executor that is still there when its worker has died."""

    def submit(self, function, *arguments):
        future = Future()
        future.set_exception(BrokenExecutor("killed"))
        return future


def test_a_worker_that_dies_again_with_the_same_tile(tree, tmp_path):
    with pytest.raises(ComputationError, match=r"died twice with the same tile.*smaller blocks"):
        with temporary_block_store(placed(), tree, tmp_path) as store, _Deadly(1) as executor:
            compute_blocks(store, heights, (0.3,), workers=Workers(executor=executor))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("task", "error"), [(fails, InputError), (interrupted, KeyboardInterrupt)])
def test_what_a_task_raises_ends_the_computation(tree, tmp_path, task, error):
    told = []
    with pytest.raises(error) as caught, temporary_block_store(placed(), tree, tmp_path) as store:
        with ThreadPoolExecutor(2) as executor:
            workers = Workers(executor=executor)
            compute_blocks(store, task, workers=workers, progress=lambda *own: told.append(own))
    assert error is KeyboardInterrupt or str(caught.value).startswith("block ")
    assert told == []
    assert list(tmp_path.iterdir()) == []


class _FullDisk:
    """A file on a disk with room for some bytes."""

    room = 0

    def __init__(self, file):
        self._file = file

    def __getattr__(self, name):
        return getattr(self._file, name)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._file.close()

    def write(self, content):
        _FullDisk.room -= len(content)
        if _FullDisk.room < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self._file.write(content)


def test_a_disk_without_room_is_said_before_the_work_begins(tree, tmp_path, monkeypatch):
    def no_room(file, start, size):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", no_room)
    with pytest.raises(InputError) as caught, temporary_block_store(placed(), tree, tmp_path):
        pass
    assert str(caught.value).startswith(f"{tmp_path}: the disk is full")
    assert "0.2 MB are needed; free some room there, or choose a folder on another disk" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".points", ".records", "height"])
def test_a_disk_that_fills(tree, tmp_path, monkeypatch, suffix):
    opened = type(tmp_path).open

    def limited(path, mode="r", *rest, **named):
        file = opened(path, mode, *rest, **named)
        return _FullDisk(file) if path.name.endswith(suffix) and "r" not in mode else file

    monkeypatch.setattr(type(tmp_path), "open", limited)
    monkeypatch.setattr(_FullDisk, "room", 10_000)
    with pytest.raises(InputError, match="the disk is full") as caught, ThreadPoolExecutor(1) as executor:
        with temporary_block_store(placed(), tree, tmp_path) as store:
            computed(store, workers=Workers(executor=executor))
    assert str(tmp_path) in str(caught.value)
    assert ".gmmjax" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_changes_while_it_is_read(tree, tmp_path):
    for count in (2_900, 3_100):
        with (
            pytest.raises(InputError, match="changed while it was read"),
            temporary_block_store(placed(count=count), tree, tmp_path),
        ):
            pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there(tree, tmp_path):
    with (
        pytest.raises(InputError, match="missing: cannot be written"),
        temporary_block_store(placed(), tree, tmp_path / "missing"),
    ):
        pass


class AtOnce(Executor):
    """Computes when it is asked, and counts."""

    def __init__(self):
        self.submitted = 0

    def submit(self, function, /, *arguments, **named):
        self.submitted += 1
        future = Future()
        future.set_result(function(*arguments, **named))
        return future


def test_a_worker_has_its_next_tile_before_anything_is_made_of_the_last_one(tree, tmp_path):
    executor, told = AtOnce(), []
    tiles = len(tiles_of(tree, settings=TileSettings(points=800.0)))
    with temporary_block_store(placed(), tree, tmp_path) as store:
        compute_blocks(
            store,
            heights,
            (0.3,),
            workers=Workers(executor=executor, capacity=1),
            progress=lambda *_: told.append(executor.submitted),
            settings=TileSettings(points=800.0),
        )
    assert told == [min(number + 1, tiles) for number in range(1, tiles + 1)]


def test_the_workers_of_a_pool_stay_for_the_next_task_unless_one_fails(tree, tmp_path):
    def processes(store):
        return {int(result.values["process"]) for _, result in compute_blocks(store, process, workers=pool)}

    pool = Workers(1).pool(2)
    with temporary_block_store(placed(), tree, tmp_path) as store:
        try:
            (first,), (second,) = processes(store), processes(store)
            assert first == second != os.getpid()
            with pytest.raises(InputError, match="cannot be computed"):
                compute_blocks(store, fails, workers=pool)
            (third,) = processes(store)
            assert third != first
        finally:
            pool.stop(at_once=False)


def test_tiles_hold_each_block_once(tree):
    for size in (None, 2.0, 50.0):
        tiles = tiles_of(tree, size, TileSettings(points=800.0))
        assert sorted(number for tile in tiles for number in tile) == list(range(len(tree)))
    assert len(tiles_of(tree, 50.0)) == 1
    for tile in tiles_of(tree, 2.0):
        centres = (tree.lowers + tree.edges[:, None] / 2)[list(tile)]
        assert len({tuple(own) for own in centres // 2.0}) == 1


def test_a_tile_size_that_cannot_be_used(tree):
    spacing = max(tree.spacing)
    tiles_of(tree, 10.01 * spacing)
    with pytest.raises(InputError, match="is below 10 point spacings of the sparser scan; give at least 1"):
        tiles_of(tree, 9.9 * spacing)
    for size in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match="must be positive and finite"):
            tiles_of(tree, size)


def test_two_places_to_compute_are_one_too_many():
    with pytest.raises(InputError, match="two places"), ThreadPoolExecutor(1) as executor:
        Workers(scheduler="tcp://127.0.0.1:1", executor=executor)
    with pytest.raises(InputError, match="workers=0 must be at least 1"):
        Workers(0)


def test_an_array_cloud_is_a_chunked_cloud():
    cloud = ArrayCloud(slope(10, 0))
    chunks = list(cloud.chunks(4))
    assert [len(chunk.points) for chunk in chunks] == [4, 4, 2]
    assert np.concatenate([chunk.rows for chunk in chunks]).tolist() == list(range(10))
