"""Blocks on many workers: the same results whatever the tiles and workers are, and whatever happens to them."""

import dataclasses
import errno
import os
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmmjax.clouds import open_cloud, working_folder, write_ply
from gmmjax.errors import ComputationError, InputError
from gmmjax.pair import Pair
from gmmjax.tiling import (
    PlacedClouds,
    RowColumns,
    Workers,
    compute,
    compute_blocks,
    row_columns,
    tiles_of,
    tree_of,
    write_block_store,
)
from tests.clouds.made_clouds import slope
from tests.tiling.stores import placed
from tests.tiling.tasks import fails, heights, heights_after_death, interrupted, process

POINTS = Pair(*(slope(count, seed, lower=(5_432_100.0, 5_678_900.0, 400.0)) for seed, count in enumerate((3000, 2000))))


@pytest.fixture(scope="module")
def tree():
    found = tree_of(placed(POINTS), 300, 8)
    assert len(found) > 30
    return found


@pytest.fixture
def store(tree, tmp_path):
    """The store in a folder that is removed whatever happens."""
    with working_folder(tmp_path) as folder:
        yield write_block_store(placed(POINTS), tree, folder)
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]


def computed(store, task=heights, arguments=(0.3,), **where):
    """All that a computation gives, as bytes."""
    records = compute_blocks(store, task, arguments, **where)
    return [(number, *(own.tobytes() for own in records.values(number).values())) for number in records.numbers]


@pytest.fixture(scope="module")
def expected(tree, tmp_path_factory):
    with ThreadPoolExecutor(1) as one:
        store = write_block_store(placed(POINTS), tree, tmp_path_factory.mktemp("expected"))
        return computed(store, workers=Workers(executor=one))


@settings(max_examples=6)
@given(
    size=st.integers(150, 3_000),
    tile=st.sampled_from([None, 3.0, 5.0, 20.0]),
    threads=st.integers(1, 3),
)
def test_tiles_workers_and_chunks_change_nothing(tree, expected, tmp_path_factory, size, tile, threads):
    store = write_block_store(placed(POINTS, size=size), tree, tmp_path_factory.mktemp("tiles"))
    with ThreadPoolExecutor(threads) as executor:
        assert computed(store, tile_size=tile, workers=Workers(executor=executor, capacity=4)) == expected


def test_values_come_to_their_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(row_columns, "BATCH", 400)
    random = np.random.default_rng(0)
    columns, values = RowColumns(tmp_path / "columns", 1_000), random.normal(size=900).astype(np.float32)
    for rows in np.split(random.permutation(900), 9):
        columns.fill(rows, {"distance": values[rows], "label": rows.astype(np.int32)})
    columns.flush()
    np.testing.assert_array_equal(columns.column("distance")[:900], values)
    np.testing.assert_array_equal(columns.column("label")[:900], np.arange(900))
    # What nobody filled is missing, and files of points have no truth values.
    assert (columns.column("label")[900:] == -1).all() and np.isnan(columns.column("distance")[900:]).all()
    assert columns.fields()["unobserved"].dtype == np.uint8


@pytest.mark.slow
def test_a_killed_worker(store, expected, tmp_path):
    mark, told = tmp_path / "killed", []
    found = computed(
        store,
        heights_after_death,
        (0.3, mark),
        workers=Workers(2),
        tile_size=3.0,
        progress=lambda message, share: told.append(share),
    )
    assert mark.exists()
    assert found == expected
    assert told == sorted(told)
    assert told[-1] == 1


class _Deadly(ThreadPoolExecutor):
    """An executor that is still there when its worker has died."""

    def submit(self, function, *arguments):
        future = Future()
        future.set_exception(BrokenExecutor("killed"))
        return future


def test_a_worker_that_dies_again_with_the_same_tile(store):
    with (
        pytest.raises(ComputationError, match=r"died twice with the same tile.*smaller blocks"),
        _Deadly(1) as executor,
    ):
        compute_blocks(store, heights, (0.3,), workers=Workers(executor=executor))


@pytest.mark.parametrize(("task", "error"), [(fails, InputError), (interrupted, KeyboardInterrupt)])
def test_what_a_task_raises_ends_the_computation(store, task, error):
    told = []
    with pytest.raises(error) as caught, ThreadPoolExecutor(2) as executor:
        compute_blocks(store, task, workers=Workers(executor=executor), progress=lambda *own: told.append(own))
    assert error is KeyboardInterrupt or str(caught.value).startswith("block ")
    assert told == []


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
    with pytest.raises(InputError) as caught, working_folder(tmp_path) as folder:
        write_block_store(placed(POINTS), tree, folder)
    assert str(caught.value).startswith(f"{tmp_path}: the disk is full")
    assert "0.2 MB are needed; free some room there, or choose a folder on another disk" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".points", ".records", "probability"])
def test_a_disk_that_fills(tree, tmp_path, monkeypatch, suffix):
    opened = type(tmp_path).open

    def limited(path, mode="r", *rest, **named):
        file = opened(path, mode, *rest, **named)
        return _FullDisk(file) if path.name.endswith(suffix) and "r" not in mode else file

    monkeypatch.setattr(type(tmp_path), "open", limited)
    monkeypatch.setattr(_FullDisk, "room", 10_000)
    with pytest.raises(InputError, match="the disk is full") as caught, ThreadPoolExecutor(1) as executor:
        with working_folder(tmp_path) as folder:
            computed(write_block_store(placed(POINTS), tree, folder), workers=Workers(executor=executor))
            RowColumns(folder / "before", 3_000)
    assert str(tmp_path) in str(caught.value)
    assert ".gmmjax" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("count", [2_900, 3_100])
def test_a_file_that_changes_while_it_is_read(tree, tmp_path, count):
    changed = placed(Pair(np.resize(POINTS.before, (count, 3)), POINTS.after))
    with pytest.raises(InputError, match="changed while it was read"):
        write_block_store(dataclasses.replace(changed, lattice=tree.lattice), tree, tmp_path)


def test_a_file_that_is_cut_off_in_its_middle(tree, tmp_path):
    files = Pair(tmp_path / "before.ply", tmp_path / "after.npy")
    write_ply(files.before, POINTS.before)
    np.save(files.after, POINTS.after)
    clouds = PlacedClouds(files.map(open_cloud), tree.lattice)
    os.truncate(files.after, 30_000)
    with pytest.raises(InputError, match=r"after\.npy: "), working_folder(tmp_path) as folder:
        write_block_store(clouds, tree, folder)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["after.npy", "before.ply"]


class AtOnce(Executor):
    """Computes when it is asked, and counts."""

    def __init__(self):
        self.submitted = 0

    def submit(self, function, /, *arguments, **named):
        self.submitted += 1
        future = Future()
        future.set_result(function(*arguments, **named))
        return future


def test_a_worker_has_its_next_tile_before_anything_is_made_of_the_last_one(store):
    executor, told = AtOnce(), []
    tiles = len(tiles_of(store.tree, 3.0))
    compute_blocks(
        store,
        heights,
        (0.3,),
        tile_size=3.0,
        workers=Workers(executor=executor, capacity=1),
        progress=lambda *_: told.append(executor.submitted),
    )
    assert told == [min(number + 1, tiles) for number in range(1, tiles + 1)]


@pytest.mark.slow
def test_the_workers_of_a_pool_stay_for_the_next_task_unless_one_fails(store):
    def processes():
        records = compute_blocks(store, process, workers=pool)
        return {int(records.values(number)["process"]) for number in records.numbers}

    pool = Workers(1).pool(2)
    try:
        (first,), (second,) = processes(), processes()
        assert first == second != os.getpid()
        with pytest.raises(InputError, match="cannot be computed"):
            compute_blocks(store, fails, workers=pool)
        (third,) = processes()
        assert third != first
    finally:
        pool.stop(at_once=False)


def test_tiles_hold_each_block_once(tree, monkeypatch):
    monkeypatch.setattr(compute, "TILE_POINTS", 800.0)
    for size in (None, 3.0, 50.0):
        tiles = tiles_of(tree, size)
        assert sorted(number for tile in tiles for number in tile) == list(range(len(tree)))
        assert (len(tiles) == 1) == (size == 50.0)
    for tile in tiles_of(tree, 3.0):
        centres = (tree.lowers + tree.edges[:, None] / 2)[list(tile)]
        assert len({tuple(own) for own in centres // 3.0}) == 1


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
