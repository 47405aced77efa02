"""That the held-out scenes are what they say: rays meet what is there, and the truth is where things changed."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax import InputError
from gmmjax.changes import Survey
from gmmjax.evaluation import Detection, Scores
from gmmjax.geometry import rotation_about, transformed
from gmmjax.pair import Pair
from tests.benchmarks.held_out import KINDS, __main__, held_out_pair, held_out_sources, meshes
from tests.benchmarks.held_out.casting import Thing, first_hits
from tests.benchmarks.held_out.records import motion_errors
from tests.benchmarks.held_out.sensors import camera, looking
from tests.benchmarks.held_out.table import Line


def test_rays_meet_the_nearest_surface():
    block = Thing(meshes.shifted(meshes.box(2, 2, 1), (0, 0, -0.5)))
    ball = Thing(meshes.shifted(meshes.ellipsoid(2, 2, 2, 40, 80), (5, 0, -1)))
    directions = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    hits = first_hits([block, ball], np.array([3.0, 0, 0]), directions)
    np.testing.assert_allclose(hits.ranges, [1, np.inf, 2, np.inf], atol=0.01)
    np.testing.assert_array_equal(hits.thing, [1, -1, 0, -1])
    # From within a box every ray meets one of its sides.
    random = np.random.default_rng(0).standard_normal((500, 3))
    inside = random / np.linalg.norm(random, axis=1, keepdims=True)
    expected = 1 / (np.abs(inside) / (1, 1, 0.5)).max(axis=1)
    np.testing.assert_allclose(first_hits([block], np.zeros(3), inside).ranges, expected)


def test_a_camera_sees_what_nothing_hides():
    wall = Thing(meshes.shifted(meshes.box(0.1, 4, 4), (3, 0, -2)))
    block = Thing(meshes.shifted(meshes.box(0.2, 1, 1), (1.5, 0, -0.5)))
    sensor, pose = camera(40, 30, 60.0, 5.0, (0.0,), lost=0.0), looking((0, 0, 0), (1, 0, 0))
    frame = sensor.frame([wall, block], pose, np.random.default_rng(0))
    measured = frame.measured @ pose[:3, :3].T
    np.testing.assert_allclose(measured[frame.thing == 0][:, 0], 2.95)
    np.testing.assert_allclose(measured[frame.thing == 1][:, 0], 1.4)
    places = np.array([[2.95, 0.0, 0.0], [2.95, 1.3, 0.0], [0.7, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    np.testing.assert_array_equal(sensor.sees(places, [wall, block], pose, 0.03), [False, True, True, False])


def test_a_seed_gives_one_scene_and_its_truth():
    # The first one that is drawn from this seed has no change within sight.
    pair, same = (held_out_pair("single_frame", 3, True) for _ in range(2))
    np.testing.assert_array_equal(pair.after.points, same.after.points)
    assert not pair.unchanged
    assert held_out_pair("single_frame", 3, False).unchanged
    for cloud in (pair.before, pair.after):
        assert np.isfinite(cloud.points).all() and len(cloud.points) == len(cloud.truth) == len(cloud.unseen)
        assert (cloud.truth < 0).mean() > 0.8 and cloud.unseen.mean() < 0.2


def test_a_box_moves_by_what_its_kind_says():
    pair = held_out_pair("box_by_10_cm", 3, True)
    before, after = (cloud.points[cloud.truth == 0] for cloud in (pair.before, pair.after))
    assert np.linalg.norm(after.mean(axis=0) - before.mean(axis=0)) == pytest.approx(0.1, abs=0.03)
    assert not pair.before.not_counted and not pair.after.not_counted
    assert np.linalg.norm(pair.motions[0][:3, 3]) == pytest.approx(0.1)
    np.testing.assert_allclose(pair.motions[0][:3, :3], np.eye(3), atol=1e-9)


def test_the_error_of_a_motion_is_that_at_the_object():
    pair = held_out_pair("box_by_10_cm", 3, True)
    turn = Rotation.from_euler("z", 2, degrees=True).as_matrix()
    centre = pair.before.points[pair.before.truth == 0].mean(axis=0)
    arrives = transformed(centre[None], pair.motions[0])[0]
    off = rotation_about(turn, arrives, arrives + np.array([0.02, 0, 0])) @ pair.motions[0]
    record = SimpleNamespace(items=[SimpleNamespace(transform=off)], diagnostics={"spacing": 0.01})
    labels = Pair(pair.before.truth, np.where(pair.after.truth == 0, 1, -1))
    (error,) = motion_errors(pair, Detection(*labels, moved=((0, 1),), changes=record))
    assert error.degrees == pytest.approx(2)
    assert error.spacings == pytest.approx(2)


def test_poses_change_nothing_but_the_views():
    known, unknown = (held_out_pair("single_frame", 1, True, poses) for poses in ("given", "unknown"))
    np.testing.assert_array_equal(known.after.points, unknown.after.points)
    assert unknown.after.views is None
    own = known.after.views.in_camera(known.after.points, 0)
    assert known.after.views.in_field_of_view(own).mean() > 0.99
    assert Survey.of(known.after.points, known.after.views).views is not None


def test_sources_name_kind_poses_and_condition():
    sources = held_out_sources(["room", "street"], [4, 5], ["given"])
    names = [(source.group, source.condition, source.name) for source in sources]
    kinds, conditions = ("room", "street"), ("changed", "unchanged")
    expected = itertools.product(kinds, conditions, (4, 5))
    assert names == [(f"{kind}, poses given", condition, f"{kind} {seed}") for kind, condition, seed in expected]
    assert len(held_out_sources()) == 4 * len(KINDS)
    with pytest.raises(InputError, match="'garden' is unknown; choose from room"):
        held_out_sources(["garden"])


def test_false_changes_in_unchanged_scenes_cost_a_setting_its_place():
    found = Scores(true_segments=2, segments=2, found=2, changes=2)
    good = Line("room", "c2c: a", found, Scores(unchanged_pairs=1))
    bad = Line("room", "c2c: b", found, Scores(segments=3, unchanged_pairs=1, false_in_unchanged=3))
    assert good.goodness > bad.goodness


def test_the_command_writes_a_line_for_each_detector(tmp_path, monkeypatch, capsys):
    table = tmp_path / "table.md"
    options = "--kinds single_frame --seeds 1 --poses unknown --methods c2c voxels --out"
    monkeypatch.setattr("sys.argv", ["held_out", *options.split(), str(table)])
    __main__.main()
    rows = table.read_text().splitlines()
    assert [row.split(" | ")[:2] for row in rows[2:]] == [
        ["| single_frame, poses unknown", name] for name in ("c2c", "voxels")
    ]
    assert table.read_text() in capsys.readouterr().out


@pytest.mark.parametrize("options", ["--seeds 0", "--out nowhere/table.md"])
def test_the_command_refuses_before_it_starts(options, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["held_out", *options.split()])
    with pytest.raises(SystemExit):
        __main__.main()
    assert options.split()[0] in capsys.readouterr().err
