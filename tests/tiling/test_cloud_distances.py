"""M3C2 distances at all points of two scans that are read in chunks."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from gmmjax.clouds import BlockSettings, PlacedClouds, open_cloud, tree_of, write_ply
from gmmjax.errors import InputError
from gmmjax.geometry import rotation_about, transformed
from gmmjax.pair import Pair
from gmmjax.tiling import DistanceSettings, Workers, distances, temporary_block_store
from tests.clouds.made_clouds import ChunkedArray, slope

BLOCKS = BlockSettings(voxels=16, cells=4, cell_points=1.0)
PLACE = np.array([5_432_100.0, 5_678_900.0, 400.0])
RISE = 0.25


def pair(lower=(0.0, 0.0, 0.0)):
    return Pair(slope(6_000, 0, lower=lower), slope(5_000, 1, lower=lower, change=RISE))


def found(points, *, threads=1, size=1_000_000, transform=None, folder=None, **named):
    """The columns of both clouds, and the numbers of points that have a distance, and a significant one."""
    clouds = PlacedClouds(points.map(lambda own: ChunkedArray(own, size)), transform)
    with ThreadPoolExecutor(threads) as executor:
        workers = Workers(executor=executor)
        with distances(clouds, workers=workers, blocks=BLOCKS, folder=folder, **named) as result:
            columns = result.columns.map(lambda own: {name: np.array(own.column(name)) for name in own.names})
            return columns, result.compared, result.significant


def test_what_rose_has_its_distance_and_nothing_else_is_significant(tmp_path):
    points = pair()
    columns, compared, significant = found(points, folder=tmp_path)
    for own, cloud, count, beyond in zip(columns, points, compared, significant, strict=True):
        distance, limit = own["distance"], own["level_of_detection"]
        assert distance.dtype == np.float32
        from_change = np.hypot(*(cloud[:, :2] - 5).T)
        inside, outside = from_change < 1.2, from_change > 3
        # Along the normal, on a slope.
        assert np.median(distance[inside]) == pytest.approx(RISE, abs=0.03)
        assert abs(np.nanmedian(distance[outside])) < 0.002
        assert (distance[inside] > limit[inside]).mean() > 0.95
        assert (np.abs(distance[outside]) > limit[outside]).mean() < 0.12
        np.testing.assert_allclose(own["significance"] > 1.96, np.abs(distance) > limit)
        assert count == np.isfinite(distance).sum() > 0.95 * len(cloud)
        assert beyond == (np.abs(distance) > limit).sum()


def test_chunks_tiles_and_workers_change_nothing(tmp_path):
    first = found(pair(), folder=tmp_path)
    second = found(pair(), threads=3, size=999, tile_size=4.0, folder=tmp_path)
    assert first[1:] == second[1:]
    for own, other in zip(first[0], second[0], strict=True):
        for name in own:
            assert own[name].tobytes() == other[name].tobytes()
    assert list(tmp_path.iterdir()) == []


def test_survey_coordinates_and_a_transform_lose_nothing(tmp_path):
    near = found(pair(), folder=tmp_path)[0]
    far = pair(PLACE)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    back = rotation_about(turn, far.after[0], far.after[0] + [30.0, 20.0, 10.0])
    turned = Pair(far.before, transformed(far.after, np.linalg.inv(back)))
    for own, other in zip(near, found(turned, transform=back, folder=tmp_path)[0], strict=True):
        same = np.isfinite(own["distance"]) & np.isfinite(other["distance"])
        assert same.mean() > 0.95
        # The sum of a few hundred numbers that were rounded to 1e-9 m; points on a voxel's side may change the voxel.
        close = np.isclose(own["distance"][same], other["distance"][same], atol=1e-6)
        assert close.mean() > 0.99


def test_files_and_the_sense_of_the_sensor(tmp_path):
    points = pair()
    files = Pair(tmp_path / "it's <before> é.ply", tmp_path / "after \x1b.npy")
    write_ply(files.before, points.before)
    np.save(files.after, points.after)
    below = np.array([[5.0, 5.0, -30.0]])
    clouds = PlacedClouds(files.map(open_cloud))
    with ThreadPoolExecutor(1) as executor:
        named = {"workers": Workers(executor=executor), "blocks": BLOCKS, "positions": Pair(below, below)}
        with distances(clouds, settings=DistanceSettings(radius=0.4, depth=1.0), **named) as result:
            sunk = result.columns.before.column("distance")[np.hypot(*(points.before[:, :2] - 5).T) < 1]
            assert np.median(sunk) == pytest.approx(-RISE, abs=0.03)


def test_a_file_that_is_cut_off_in_its_middle(tmp_path):
    points, folder = pair(), tmp_path / "work"
    folder.mkdir()
    files = Pair(tmp_path / "before.ply", tmp_path / "after.npy")
    write_ply(files.before, points.before)
    np.save(files.after, points.after)
    clouds = PlacedClouds(files.map(open_cloud))
    tree = tree_of(clouds, BLOCKS)
    os.truncate(files.after, 60_000)
    with pytest.raises(InputError, match=r"after\.npy: "), temporary_block_store(clouds, tree, folder):
        pass
    assert list(folder.iterdir()) == []


def test_what_cannot_be_compared(tmp_path):
    points = pair()
    apart = Pair(points.before, points.after + np.array([200.0, 0.0, 0.0]))
    with pytest.raises(
        InputError, match=r"the scans do not overlap \(before (-?0.*\.\.10.* x ){2}.*after 200.*register them first"
    ) as caught:
        found(apart, folder=tmp_path)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="is below 10 point spacings"):
        found(points, tile_size=0.01, folder=tmp_path)
    with pytest.raises(InputError, match=r"no point has points of the other scan in its cylinder.*larger depth"):
        above = Pair(points.before, points.after + np.array([0.0, 0.0, 3.0]))
        found(above, folder=tmp_path, settings=DistanceSettings(radius=0.2, depth=0.01))
    for name in ("radius", "depth", "registration_error"):
        with pytest.raises(InputError, match=f"{name}=-1.0 must be"):
            DistanceSettings(**{name: -1.0})
    assert list(tmp_path.iterdir()) == []
