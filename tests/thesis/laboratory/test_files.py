import json

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.clouds import read_cloud
from gmmjax.evaluation import find_pairs
from gmmjax.surveys import open_bag
from gmmjax.thesis.laboratory import THINGS, files, recorded_run
from gmmjax.thesis.laboratory.files import LabSettings, write_lab

PAIRS = (("run5", "run1"), ("run1", "run5"))
SMALL = LabSettings(frames=4, pairs=PAIRS)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab") / "scenes"
    return folder, write_lab(folder, LabSettings(frames=4, pairs=PAIRS, bag="ros1"))


def contents(folder):
    return {str(path.relative_to(folder)): path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.mark.slow
def test_all_that_is_written_is_described(lab):
    folder, description = lab
    assert description == {
        "surveys/": "what the robot recorded in each run",
        "*-run5-run1/": "robot appeared, cargo bag appeared",
        "*-run1-run5/": "robot disappeared, cargo bag disappeared",
    }
    pairs = {f"{kind}-{runs}" for kind in ("frame", "localised") for runs in ("run5-run1", "run1-run5")}
    assert {path.name for path in folder.iterdir()} == {*pairs, "surveys", "lab.json"}
    content = json.loads((folder / "lab.json").read_text())
    assert content["things"] == list(THINGS)
    assert {pair["folder"] for pair in content["pairs"]} == pairs
    assert set(content["runs"]["run1"]) == {"cargo bag", "robot"} and content["settings"]["seed"] == 0


def test_the_pairs_are_what_evaluation_reads(lab):
    changed = {THINGS.index("robot"), THINGS.index("cargo bag")}
    for source in find_pairs(lab[0]):
        pair = source.load()
        with_objects, other = (
            (pair.after, pair.before) if source.name.endswith("run5-run1") else (pair.before, pair.after)
        )
        assert set(np.unique(with_objects.truth)) - {-1} <= changed and (with_objects.truth >= 0).any()
        assert (other.truth == -1).all()
        assert with_objects.unseen is not None and not with_objects.unseen.all()
        assert len(with_objects.views) == (1 if source.name.startswith("frame") else 4)


def test_a_run_has_what_the_robot_recorded(lab):
    home = lab[0] / "surveys" / "run1"
    recording = recorded_run("run1", 0, frames=4)
    with np.load(home / "poses.npz") as poses:
        np.testing.assert_array_equal(poses["poses_true"], recording.poses)
    with open_bag(home / "survey.bag") as bag:
        for frame, recorded in zip(bag.frames(), recording.frames, strict=True):
            np.testing.assert_array_equal(frame.cloud.points, recorded.cloud.points)
            assert frame.time == pytest.approx(recorded.time, abs=1e-6)
        for topic, trajectory in (("/loc/ground_truth", recording.localised), ("/loc/adjusted", recording.adjusted)):
            np.testing.assert_allclose(bag.trajectory(topic).poses, trajectory.poses, atol=1e-9)
    after = read_cloud(lab[0] / "localised-run5-run1" / "after.ply")
    np.testing.assert_array_equal(read_cloud(home / "localised.ply").points, after.points)


def test_only_a_laboratory_is_replaced(lab, tmp_path):
    before = contents(lab[0])
    with pytest.raises(InputError, match="holds a previous simulated laboratory; --overwrite replaces it"):
        write_lab(lab[0], SMALL)
    assert contents(lab[0]) == before
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match=r"holds something else \(letter.txt\)"):
        write_lab(tmp_path, SMALL, overwrite=True)


@pytest.mark.slow
def test_what_was_there_is_replaced_as_a_whole_or_not_at_all(tmp_path, monkeypatch):
    small = LabSettings(frames=4, kinds=("frame",), pairs=PAIRS[:1])
    write_lab(tmp_path / "scenes", small)
    before = contents(tmp_path / "scenes")

    def broken(*arguments, **keywords):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(files, "write_views", broken)
        with pytest.raises(InputError, match="No space left on device"):
            write_lab(tmp_path / "scenes", small, overwrite=True)
    assert contents(tmp_path / "scenes") == before
    write_lab(tmp_path / "scenes", LabSettings(frames=4, kinds=("frame",), pairs=PAIRS[1:]), overwrite=True)
    assert {path.name for path in (tmp_path / "scenes").iterdir()} == {"frame-run1-run5", "surveys", "lab.json"}
