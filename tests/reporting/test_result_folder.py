import dataclasses
import errno
import json
import os
import re
import tomllib

import numpy as np
import pytest

from gmmjax.changes import Changes, DetectionConfig
from gmmjax.changes.registration import Registration
from gmmjax.clouds import PointCloud, read_cloud
from gmmjax.errors import InputError
from gmmjax.geometry.rigid import rigid_transform
from gmmjax.reporting import write_result

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


def test_the_after_cloud_is_written_and_shown_in_the_frame_of_the_before_cloud(pair, tmp_path):
    transform = rigid_transform(translation=np.array([0.0, 0.0, -2.0]))
    registration = Registration(transform, True, 2.0, 0.01, 0.5, 0.9)
    changes = dataclasses.replace(pair[2], registration=registration)
    folder = write_result(tmp_path / "result", pair[0], pair[1], changes)
    np.testing.assert_allclose(read_cloud(folder / "after.ply").points, pair[1].points + np.array([0, 0, -2]))
    np.testing.assert_array_equal(read_cloud(folder / "before.ply").points, pair[0].points)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "The after scan was moved by 2 and 0°" in page
    np.testing.assert_array_equal(Changes.load(folder).registration.transform, transform)
