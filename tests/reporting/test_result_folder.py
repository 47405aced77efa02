import dataclasses
import errno
import json
import os
import re
import tomllib
from types import SimpleNamespace
from unittest.mock import Mock

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.batch.worker import FoundPair
from gmmjax.changes import Changes, Consensus, DetectionConfig
from gmmjax.changes.registration import Registration
from gmmjax.clouds import PointCloud, open_survey, read_cloud, read_survey, write_pcd
from gmmjax.errors import InputError, InputWarning
from gmmjax.geometry.rigid import rigid_transform
from gmmjax.pair import Pair
from gmmjax.reporting import save_report, save_transformed_report, write_result
from gmmjax.reporting.result_folder import write_tiled_result
from gmmjax.tiling import TiledChanges

FILES = {
    *("changes.json", "changes.csv", "changes.geojson", "labels.npz"),
    *("before.ply", "after.ply", "report.html", "config.toml"),
}


@pytest.fixture(scope="module")
def result(pair, tmp_path_factory):
    return write_result(tmp_path_factory.mktemp("results") / "result", *pair)


def test_all_outputs_are_there(result):
    assert {path.name for path in result.iterdir()} == FILES


def test_changes_and_settings_are_read_back(result, pair):
    loaded = Changes.load(result)
    np.testing.assert_array_equal(loaded.labels_after, pair[2].labels_after)
    assert [change.kind for change in loaded.items] == [change.kind for change in pair[2].items]
    assert DetectionConfig.from_dict(tomllib.loads((result / "config.toml").read_text())) == pair[2].config


@pytest.mark.parametrize("side", ["before", "after"])
def test_clouds_have_all_points_in_order_with_label_and_probability(result, pair, side):
    cloud = pair[side == "after"]
    written = read_cloud(result / f"{side}.ply")
    np.testing.assert_array_equal(written.points, cloud.points)
    np.testing.assert_array_equal(written.fields["label"], getattr(pair[2], f"labels_{side}"))
    np.testing.assert_allclose(written.fields["probability"], getattr(pair[2], f"probability_{side}"), rtol=1e-6)
    assert written.fields["label"].dtype == np.int32
    assert written.fields["probability"].dtype == np.float32


def test_rows_of_the_source_are_told_where_some_were_dropped(result, pair):
    np.testing.assert_array_equal(read_cloud(result / "before.ply").fields["row"], pair[0].rows)
    assert "row" not in read_cloud(result / "after.ply").fields


def test_changes_stand_out_by_colour(result):
    colors = read_cloud(result / "after.ply").colors
    assert (colors[:60] == [0x00, 0x72, 0xB2]).all()
    assert (colors[60:130] == [0x00, 0x9E, 0x73]).all()
    assert (np.ptp(colors[130:].astype(int), axis=1) < 20).all()


def test_stray_points_are_written_and_not_shown(pair, tmp_path):
    before, after, changes = pair
    stray = PointCloud.from_rows(np.concatenate([after.points, [[3.4e38, 0, 0], [0, 1e6, 0]]]))
    arrays = {name: getattr(changes, f"{name}_after") for name in ("labels", "probability", "unobserved")}
    longer = {f"{name}_after": np.append(values, np.full(2, -1, values.dtype)) for name, values in arrays.items()}
    write_result(tmp_path / "a", before, stray, dataclasses.replace(changes, **longer))
    assert len(read_cloud(tmp_path / "a" / "after.ply")) == len(stray)
    page = (tmp_path / "a" / "report.html").read_text()
    scene = json.loads(re.search(r'id="scene">(.*?)</script>', page, re.DOTALL)[1])
    assert scene["after"]["count"] == len(after)
    assert np.abs([scene["shown"]["lower"], scene["shown"]["upper"]]).max() < 10


def test_clouds_of_other_changes_are_refused(pair, tmp_path):
    before, _, changes = pair
    with pytest.raises(InputError, match="400 points"):
        write_result(tmp_path / "a", before, before, changes)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("fail_at", range(1, 9))
def test_a_disk_that_fills_leaves_no_result_and_the_old_one_whole(pair, tmp_path, monkeypatch, fail_at):
    old = write_result(tmp_path / "old", *pair)
    kept = {path.name: path.read_bytes() for path in old.iterdir()}
    fsync, calls = os.fsync, []

    def full_later(descriptor):
        calls.append(descriptor)
        if len(calls) % 7 == fail_at % 7:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", full_later)
    with pytest.raises(InputError, match=r"new: cannot be written \(No space left"):
        write_result(tmp_path / "new", *pair)
    calls.clear()
    with pytest.raises(InputError, match=r"old: cannot be written \(No space left"):
        write_result(tmp_path / "old", *pair, overwrite=True)
    assert {path.name: path.read_bytes() for path in old.iterdir()} == kept
    assert [path.name for path in tmp_path.iterdir()] == ["old"]


@pytest.mark.parametrize("transform_after", [False, True])
def test_the_after_cloud_is_written_where_it_is_and_shown_in_the_frame_of_the_before_cloud(
    pair, tmp_path, transform_after
):
    transform = rigid_transform(translation=np.array([0.0, 0.0, -2.0]))
    registration = Registration(transform, True, 2.0, 0.01, 0.5, 0.9)
    changes = dataclasses.replace(pair[2], registration=registration, crs="EPSG:4978")
    with pytest.warns(InputWarning, match="in EPSG:4978, not in degrees"):
        folder = write_result(tmp_path / "result", pair[0], pair[1], changes, transform_after=transform_after)
    after = read_cloud(folder / "after.ply").points
    np.testing.assert_array_equal(after, pair[1].points + (np.array([0, 0, -2]) if transform_after else 0))
    np.testing.assert_array_equal(read_cloud(folder / "before.ply").points, pair[0].points)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "The after scan was moved by 2 and 0°" in page and "<dd>EPSG:4978</dd>" in page
    read = Changes.load(folder)
    np.testing.assert_array_equal(read.registration.transform, transform)
    assert read.crs == "EPSG:4978"


@pytest.mark.parametrize("transform_after", [False, True])
def test_a_result_in_tiles_has_the_same_scans(pair, tmp_path, transform_after):
    """Two files a side: each keeps its name and, unless asked for, its coordinates."""
    files = {}
    for side, cloud in zip(("before", "after"), pair[:2], strict=True):
        files[side] = [tmp_path / f"{side}-1.las", tmp_path / f"{side}-2.pcd"]
        scan = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
        scan.xyz = cloud.points[:200]
        scan.write(files[side][0])
        write_pcd(files[side][1], cloud.points[200:], viewpoint=(1.0, 2.0, 3.0, 0.6, 0.0, 0.8, 0.0))
    surveys, clouds = (Pair(*map(read, files.values())) for read in (open_survey, read_survey))
    transform = rigid_transform(Rotation.from_euler("z", 0.3).as_matrix(), np.array([1.0, 2.0, 0.5]))
    changes = dataclasses.replace(pair[2], registration=Registration(transform, True, 2.0, 0.01, 0.5, 0.9))
    found = Pair("before", "after").map(changes.point_values)
    found = found.map(lambda own: own | {"unobserved": own["unobserved"].astype(np.uint8)})
    rows = found.map(lambda own: SimpleNamespace(fields=lambda: own))
    tiled = TiledChanges(changes, changes, clouds, rows)
    whole = write_result(tmp_path / "whole", *clouds, changes, transform_after=transform_after)
    in_tiles = write_tiled_result(tmp_path / "tiles", surveys, tiled, transform_after=transform_after)
    for side in ("before", "after"):
        for file in files[side]:
            assert (in_tiles / side / file.name).read_bytes() == (whole / side / file.name).read_bytes()
            kept = np.array_equal(read_cloud(whole / side / file.name).points, read_cloud(file).points)
            assert kept == (side == "before" or not transform_after)


@pytest.mark.parametrize(("save", "moved"), [(save_report, False), (save_transformed_report, True)])
def test_a_batch_writes_the_after_scan_likewise(pair, tmp_path, save, moved):
    transform = rigid_transform(translation=np.array([0.0, 0.0, -2.0]))
    changes = dataclasses.replace(pair[2], registration=Registration(transform, True, 2.0, 0.01, 0.5, 0.9))
    consensus = Mock(spec=Consensus, changes=changes)
    save(tmp_path, Mock(spec=FoundPair, clouds=Pair(*pair[:2]), consensus=consensus))
    after = pair[1].points + (np.array([0, 0, -2]) if moved else 0)
    np.testing.assert_array_equal(read_cloud(tmp_path / "after.ply").points, after)
