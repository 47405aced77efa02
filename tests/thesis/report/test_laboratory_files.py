import json

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.clouds import read_cloud
from gmmjax.evaluation import find_pairs
from gmmjax.surveys import open_bag
from gmmjax.thesis.laboratory import THINGS, recorded_run
from gmmjax.thesis.report import laboratory_files, write_lab

SMALL = dict(runs=("stacked",), seed=0, kinds=("frame", "localised"), frames=4)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab") / "scenes"
    return folder, write_lab(folder, bag="ros1", **SMALL)


def contents(folder):
    return {str(path.relative_to(folder)): path.stat().st_mtime_ns for path in folder.rglob("*")}


def test_all_that_is_written_is_described(lab):
    folder, description = lab
    assert description == {
        "surveys/": "what the robot recorded in each run",
        "*-bag-stacked/": "gear box appeared",
        "*-stacked-bag/": "gear box disappeared",
    }
    pairs = {f"{kind}-{runs}" for kind in SMALL["kinds"] for runs in ("bag-stacked", "stacked-bag")}
    assert {path.name for path in folder.iterdir()} == {*pairs, "surveys", "lab.json", "index.html"}
    content = json.loads((folder / "lab.json").read_text())
    assert content["things"] == list(THINGS)
    assert {pair["folder"] for pair in content["pairs"]} == pairs
    assert set(content["runs"]["stacked"]) == {"cargo bag", "gear box"}
    assert content["settings"]["seed"] == 0


def test_the_pairs_are_what_evaluation_reads(lab):
    box = THINGS.index("gear box")
    for source in find_pairs(lab[0]):
        pair = source.load()
        changed, other = (pair.after, pair.before) if source.name.endswith("bag-stacked") else (pair.before, pair.after)
        assert set(np.unique(changed.truth)) == {-1, box}
        assert (other.truth == -1).all()
        assert changed.unseen is not None and not changed.unseen.all()
        assert changed.views is not None and len(changed.views) == (1 if source.name.startswith("frame") else 4)


def test_a_run_has_what_the_robot_recorded(lab):
    home = lab[0] / "surveys" / "stacked"
    recording = recorded_run("stacked", 0, frames=4)
    assert len(list((home / "frames").iterdir())) == 4
    first = read_cloud(home / "frames" / "frame_000.pcd")
    np.testing.assert_array_equal(first.points, recording.frames[0].cloud.points)
    assert first.views is not None
    with np.load(home / "poses.npz") as poses, np.load(home / "things.npz") as things:
        np.testing.assert_array_equal(poses["poses_true"], recording.poses)
        np.testing.assert_array_equal(things["frames"][0].reshape(-1)[first.rows], recording.things[0])
    with open_bag(home / "survey.bag") as bag:
        for frame, recorded in zip(bag.frames(), recording.frames, strict=True):
            np.testing.assert_array_equal(frame.cloud.points, recorded.cloud.points)
            assert frame.time == pytest.approx(recorded.time, abs=1e-6)
        for topic, trajectory in (("/loc/ground_truth", recording.localised), ("/loc/adjusted", recording.adjusted)):
            np.testing.assert_allclose(bag.trajectory(topic).poses, trajectory.poses, atol=1e-9)
    np.testing.assert_array_equal(
        read_cloud(home / "localised.ply").points,
        read_cloud(lab[0] / "localised-bag-stacked" / "after.ply").points,
    )


def test_only_a_laboratory_is_replaced(lab, tmp_path):
    before = contents(lab[0])
    with pytest.raises(InputError, match="holds a previous simulated laboratory; --overwrite replaces it"):
        write_lab(lab[0], bag="none", **SMALL)
    assert contents(lab[0]) == before
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match=r"holds something else \(letter.txt\)"):
        write_lab(tmp_path / "letters", bag="none", overwrite=True, **SMALL)
    assert (tmp_path / "letters" / "letter.txt").read_text() == "dear"


def test_what_was_there_is_replaced_as_a_whole_or_not_at_all(tmp_path, monkeypatch):
    small = {**SMALL, "kinds": ("frame",)}
    folder = tmp_path / "scenes"
    write_lab(folder, bag="none", **small)
    before = contents(folder)

    def broken(*arguments, **keywords):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(laboratory_files, "write_views", broken)
        with pytest.raises(InputError, match="No space left on device"):
            write_lab(folder, bag="none", overwrite=True, **small)
    assert contents(folder) == before
    write_lab(folder, bag="none", overwrite=True, **{**small, "runs": ("empty",)})
    assert {path.name for path in folder.iterdir()} == {"frame-run5-run5again", "surveys", "lab.json", "index.html"}
