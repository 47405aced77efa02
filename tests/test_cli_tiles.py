"""`gmmjax detect` in tiles: what a user with files of any size meets."""

import json
import re

import laspy
import numpy as np
import pytest

from gmmjax.changes import Changes
from gmmjax.cli import main
from gmmjax.clouds import read_cloud, write_ply
from gmmjax.reporting.summary import unobserved_text
from tests.tiling.rooms import of_box, room

QUICK = ["--restarts", "1", "--max-components", "12", "--registration", "never"]

pytestmark = pytest.mark.usefixtures("no_compilation_cache")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Two files of the first survey, one of which lacks a position, and one of the second."""
    folder = tmp_path_factory.mktemp("files")
    before, after = room(0, box=False), room(1, box=True)
    np.save(folder / "left.npy", np.insert(before[:40_000], 5, np.nan, axis=0))
    write_ply(folder / "right.ply", before[40_000:], fields={"intensity": np.arange(len(before) - 40_000, dtype="u2")})
    write_ply(folder / "after.ply", after)
    return folder


@pytest.fixture(scope="module")
def result(files, tmp_path_factory):
    """The folder of a result, with a map, a figure and what was printed."""
    folder = tmp_path_factory.mktemp("out")
    words = ["detect", "--before", files / "left.npy", files / "right.ply", "--after", files / "after.ply", "--out"]
    words += [folder / "result", "--tile-size", "3", "--workers", "1", "--temporary-folder", folder, *QUICK]
    assert main([str(word) for word in (*words, "--quiet", "--plot", folder / "plot.png")]) == 0
    return folder / "result"


@pytest.mark.slow
def test_a_result_has_every_row_of_every_file(result, files):
    changes = Changes.load(result)
    assert [change.kind for change in changes] == ["appeared"]
    after = read_cloud(result / "after.ply")
    box = of_box(after.points)
    assert (after.fields["label"][box] == 0).mean() > 0.95
    np.testing.assert_array_equal(after.fields["label"], changes.labels_after)
    assert changes[0].point_count == (changes.labels_after == 0).sum()
    left, right = (read_cloud(result / "before" / f"{name}.ply") for name in ("left", "right"))
    assert len(changes.labels_before) == 40_001 + len(right)
    assert 5 not in left.fields["row"] and left.fields["row"][-1] == 40_000
    np.testing.assert_array_equal(right.fields["intensity"], read_cloud(files / "right.ply").fields["intensity"])
    np.testing.assert_array_equal(right.fields["distance"], changes.distance_before[40_001:])
    assert set(right.fields) >= {"kind", "probability", "unobserved", "level_of_detection", "significance"}


def test_the_record_and_the_report_are_of_the_whole_scans(result):
    record = json.loads((result / "changes.json").read_text())
    assert record["diagnostics"]["before"]["source"] == "left.npy, right.ply"
    assert record["diagnostics"]["before"]["points"] == len(room(0, box=False))
    page = (result / "report.html").read_text()
    assert re.search(rf"after\.ply</bdi></b> \({len(room(1, box=True)):,} points\)", page)
    unobserved = unobserved_text(Changes.load(result))
    assert unobserved is not None
    assert f">By the other survey: {unobserved.split(': ')[1]}<" in page
    assert {path.name for path in result.parent.iterdir()} == {"result", "plot.png"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--tile-size", "0.01"], "--tile-size 0.01 is below 10 point spacings"),
        (["--workers", "0"], "workers"),
        (["--tile-size", "3", "--method", "greedy"], "--method greedy: only 'joint' compares scans in tiles"),
        (["--tile-size", "3", "--temporary-folder", "nowhere/at/all"], "nowhere/at/all: cannot be written"),
    ],
)
def test_what_cannot_be_used_is_named_and_nothing_is_written(files, tmp_path, capsys, options, message):
    paths = [str(files / name) for name in ("right.ply", "after.ply")]
    # The last setting of a flag counts.
    assert main(["detect", *paths, "--out", str(tmp_path / "out"), *QUICK, *options]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["scan.las", "scan.laz"])
def test_a_file_that_was_truncated_is_named_and_nothing_is_written(files, tmp_path, capsys, name):
    path = tmp_path / name
    scan = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    scan.xyz = room(2, box=False)
    scan.write(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    words = [str(files / "after.ply"), str(path), "--tile-size", "3", "--temporary-folder", str(tmp_path)]
    assert main(["detect", *words, "--out", str(tmp_path / "out"), *QUICK]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert name in said
    assert "cut off" in said
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
@pytest.mark.parametrize("room_left", [50_000, 1_000_000])
def test_a_disk_that_fills_leaves_nothing(files, tmp_path, capsys, room_left):
    """Files cannot get longer than that: the first is too little for columns of points, the other for the result."""
    resource = pytest.importorskip("resource")
    words = [str(files / name) for name in ("right.ply", "after.ply")]
    words += ["--tile-size", "3", "--temporary-folder", str(tmp_path), "--out", str(tmp_path / "out"), *QUICK]
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (room_left, limits[1]))
        code = main(["detect", *words])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert code == 2
    assert "cannot be written" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []
