"""That the scenes are what they say: rays meet what is there, and the truth is where surfaces changed."""

import functools
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree

from gmmjax import InputError
from gmmjax.clouds import read_cloud
from gmmjax.evaluation.labelled_pair import read_pair
from gmmjax.pair import Pair, each
from tests.benchmarks.surveyor import HELD_OUT, KINDS, __main__, accuracy, hall_scene, peers, simulated
from tests.benchmarks.surveyor.accuracy import Line, to_markdown
from tests.benchmarks.surveyor.found import found_in_large
from tests.benchmarks.surveyor.large import write_large
from tests.benchmarks.surveyor.lining import Lining
from tests.benchmarks.surveyor.scanning import Beam, World, scanned
from tests.benchmarks.surveyor.scoring import mistakes, of_unjudged_changes, scores
from tests.benchmarks.surveyor.solids import UNJUDGED, Thing, box, distances, ellipsoid, first_hits, pipe, pole
from tests.benchmarks.surveyor.surveys import Station, SurveyedPair
from tests.benchmarks.surveyor.terrain import Columns, Terrain
from tests.benchmarks.surveyor.walks import Walk

POINTS = 60_000


@functools.cache
def changed_pair(kind: str) -> SurveyedPair:
    return simulated(kind, 1, POINTS)


def test_rays_meet_the_nearest_surface_and_end_on_it():
    things = [
        Thing((box(1, 2, 1, (3, 0, -0.5)), pole(0.3, 2, (0, 3, -1)))),
        Thing((ellipsoid((0.5, 1, 2), (-3, 0, 0)), pipe(0.2, 1.5, (0, -3, -0.2)))),
    ]
    random = np.random.default_rng(0)
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1]])
    hits = first_hits(things, np.zeros(3), axes, random)
    np.testing.assert_allclose(hits.ranges, [2.5, 2.7, 2.5, 2.8, np.inf])
    np.testing.assert_array_equal(hits.thing, [0, 0, 1, 1, -1])
    directions = random.standard_normal((4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = 0.1 * random.standard_normal((4000, 3))
    hits = first_hits(things, origins, directions, random)
    met = np.isfinite(hits.ranges)
    assert 100 < met.sum() < 3000
    places = origins[met] + hits.ranges[met, None] * directions[met]
    np.testing.assert_allclose(distances(things, places, 1.0), 0, atol=1e-7)


def test_rays_meet_terrain_where_its_height_is_theirs():
    x, y = np.meshgrid(np.arange(200), np.arange(150), indexing="ij")
    terrain = Terrain(0.08 * y + 0.5 * np.sin(x / 9) * np.cos(y / 7), np.array([-10.0, 0.0]), 0.1)
    origins = np.broadcast_to([0.0, -8.0, 1.0], (40, 3))
    columns = Columns(origins, np.linspace(1.0, 2.1, 40), np.linspace(-0.1, 0.5, 60))
    ranges = terrain.ranges(columns)
    met = np.isfinite(ranges)
    assert met.mean() > 0.3
    places = (columns.origins[:, None] + np.where(met, ranges, 0)[..., None] * columns.directions())[met]
    # Linear between samples of the profile, which are not at the nodes of the grid.
    np.testing.assert_allclose(places[:, 2], terrain.at(places[:, :2]), atol=0.02)
    assert terrain.sees(origins[0], places, 0.05).mean() > 0.99
    assert not terrain.sees(origins[0], places - (0, 0, 1.0), 0.05).any()


def test_rays_meet_the_lining_of_a_tunnel_from_inside():
    length, radius, cell = 20.0, 4.0, 0.1
    first, last = Lining.arc(radius)
    x, arc = np.meshgrid(cell * np.arange(201), np.arange(first, last + cell, cell), indexing="ij")
    lining = Lining(radius, Terrain(0.1 * np.sin(x) * np.cos(2 * arc / radius), np.array([0.0, first]), cell))
    columns = Station(np.array([9.0, 0.5, -1.0])).columns(5000, np.random.default_rng(0))
    ranges = lining.ranges(columns)
    met = np.isfinite(ranges)
    places = (columns.origins[:, None] + np.where(met, ranges, 0)[..., None] * columns.directions())[met]
    # All rays but those that leave through an end, or graze the wall.
    assert met.mean() > 0.9 and (places[:, 0] > 0).all() and (places[:, 0] < length).all()
    assert lining.distances(places).max() < 1e-3
    expected = radius - 0.1 * np.sin(places[:, 0]) * np.cos(2 * np.arctan2(places[:, 2], places[:, 1]))
    np.testing.assert_allclose(np.hypot(places[:, 1], places[:, 2]), expected, atol=2e-3)
    places = places[(np.abs(places[:, 0] - length / 2) < length / 2 - cell) & (places[:, 2] > -3.5)]
    normals = lining.normals(places)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    # Into the tunnel, and across the wall: what is a little along it is on it.
    assert (-(normals * places)[:, 1:].sum(axis=1) / np.hypot(places[:, 1], places[:, 2]) > 0.95).all()
    along = np.cross(normals, np.array([1.0, 0, 0]))
    assert lining.distances(places + 0.01 * along).max() < 1e-3


@pytest.mark.parametrize(
    "scanner", [Station(np.array([0.0, 0, 1.5])), Walk(np.array([-4.0, 0, 1.5]), np.array([4.0, 0, 1.5]))]
)
def test_a_scanner_sees_what_it_scanned_and_nothing_behind_it(scanner):
    floor, wall = box(30, 30, 1, (0, 0, -1)), box(20, 0.5, 3, (0, 4, 0))
    world, random = World([Thing((floor, wall))]), np.random.default_rng(0)
    scan = scanned(world, scanner.columns(4000, random), Beam(mixed=0.0), random)
    assert len(scan.points) > 1000
    assert scanner.seen(world, scan.places, 0.02, random).mean() > 0.98
    np.testing.assert_allclose(scan.points, scan.places, atol=0.04)
    behind = scan.places[np.abs(scan.places[:, 1] - 3.75) < 1e-6] + (0, 1.0, 0)
    assert len(behind) > 100 and not scanner.seen(world, behind, 0.02, random).any()


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*KINDS, *HELD_OUT])
def test_what_changed_is_off_the_other_scan_and_the_rest_is_on_it(kind):
    pair = changed_pair(kind)
    assert any((truth >= 0).any() for truth in pair.truth)
    for own, other, truth, source in zip(pair.points, pair.points.swapped, pair.truth, pair.source, strict=True):
        assert 0.8 * POINTS < len(own) < 1.2 * POINTS and np.isfinite(own).all()
        # What nobody can judge is not another change.
        assert ((truth == source) | (truth == UNJUDGED)).all()
        unchanged = np.flatnonzero(truth == -1)[:: POINTS // 2000]
        spacing = np.median(cKDTree(own).query(own[unchanged], 2)[0][:, 1])
        assert np.median(cKDTree(other).query(own[unchanged])[0]) < 2 * spacing
        numbers, counts = np.unique(truth[truth >= 0], return_counts=True)
        assert (counts >= 40).all(), numbers


@pytest.mark.parametrize("kind", ["hall", "warehouse"])
def test_changed_points_are_where_the_other_survey_saw_no_surface(kind):
    pair = changed_pair(kind)
    changed = pair.truth.map(lambda truth: truth >= 0)
    apart = each(lambda own, rows, other: cKDTree(other).query(own[rows])[0], pair.points, changed, pair.points.swapped)
    assert np.concatenate([*apart]).min() > 0.005


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*KINDS, *HELD_OUT])
def test_the_twin_is_unchanged(kind):
    pair = simulated(kind, 1, 5_000, changed=False)
    assert pair.unchanged and all((truth < 0).all() for truth in pair.truth)


def test_a_seed_gives_one_scene_in_the_coordinates_of_a_grid():
    first, second = (hall_scene(2, 5000, stations=1) for _ in range(2))
    np.testing.assert_array_equal(first.points.after, second.points.after)
    assert first.points.before[:, 1].min() > 5e6 and len(first.views.before) == 1
    with pytest.raises(InputError, match="'cave' is unknown; choose from hall"):
        simulated("cave", 0, 5000)


def test_points_that_nobody_can_judge_count_for_nothing():
    truth = Pair(np.repeat([-1, 0, UNJUDGED], [50, 10, 40]), np.full(30, -1))
    none = Pair(np.zeros(100, bool), np.zeros(30, bool))
    pair = SurveyedPair("own", Pair(np.zeros((100, 3)), np.zeros((30, 3))), truth, none, truth, Pair(None, None))
    labels = Pair(np.repeat([-1, 3, 7], [50, 25, 25]), np.full(30, -1))
    found = scores(pair, labels)
    # The first segment has ten changed points and fifteen unjudged ones, the second unjudged ones only.
    assert (found.true_segments, found.segments, found.found) == (1, 1, 1)
    assert found.point_f1 == 1.0
    assert not mistakes(pair, labels)
    nothing = mistakes(pair, Pair(np.full(100, -1), np.repeat([-1, 2], [20, 10])))
    assert nothing[0].startswith("before: change 0 missed, 10 points") and nothing[1].startswith(
        "after: segment 2 is none"
    )


def test_a_false_segment_may_be_of_a_change_that_is_not_judged():
    truth, source = np.repeat([-1, UNJUDGED, -1], [12, 20, 68]), np.repeat([-1, 4, -1], [12, 20, 68])
    none = np.zeros(100, bool)
    pair = SurveyedPair("own", *(Pair(own, own) for own in (np.zeros((100, 3)), truth, none, source)), Pair(None, None))
    rim, elsewhere = np.repeat([-1, 3, -1], [10, 22, 68]), np.repeat([-1, 3, -1], [50, 22, 28])
    assert scores(pair, Pair(rim, elsewhere)).false_segments == 2
    assert of_unjudged_changes(pair, Pair(rim, elsewhere)) == 1
    assert of_unjudged_changes(pair, Pair(elsewhere, elsewhere)) == 0


def test_a_table_has_what_failed():
    line = Line("hall", "ours", failed=("hall 3: ValueError: nothing",))
    text = to_markdown([line])
    assert "ours (1 failed)" in text and text.endswith("- failed: hall 3: ValueError: nothing")


def test_the_command_measures_and_writes_a_table(tmp_path, monkeypatch, capsys):
    truth = [changed_pair("hall").truth, simulated("hall", 1, 5_000, changed=False).truth]
    found = iter([SimpleNamespace(labels_before=own.before, labels_after=own.after) for own in truth])
    monkeypatch.setattr(accuracy, "simulated", lambda kind, seed, points, changed: by_truth(changed))
    monkeypatch.setattr("gmmjax.detect_changes", lambda *clouds, **views: next(found))
    monkeypatch.setattr(accuracy, "displaced_text", lambda changes: None)
    monkeypatch.setattr(peers, "VOXELS", {"hall": (0.15,)})
    table = tmp_path / "table.md"
    options = "accuracy --kinds hall --seeds 1 --views unknown --peers with --out"
    monkeypatch.setattr("sys.argv", ["surveyor", *options.split(), str(table)])
    __main__.main()
    ours, peer = [row.split(" | ") for row in table.read_text().splitlines() if row.startswith("| hall")][:2]
    assert ours[1:3] == ["gmmjax, poses unknown", "1.000 / 1.000"] and ours[6] == "0 in 1"
    assert peer[1].startswith("c2c: ")
    assert table.read_text() in capsys.readouterr().out


def test_scenes_are_written_as_pairs_that_tuning_reads(tmp_path, monkeypatch):
    options = "write --kinds tunnel warehouse --seeds 1 --points 3000 --out"
    monkeypatch.setattr("sys.argv", ["surveyor", *options.split(), str(tmp_path / "pairs")])
    __main__.main()
    tunnel, warehouse = (read_pair(tmp_path / "pairs" / name) for name in ("tunnel_1", "warehouse_1"))
    made = simulated("tunnel", 1, 3000)
    np.testing.assert_array_equal(tunnel.before.truth, made.truth.before)
    np.testing.assert_allclose(tunnel.after.points, made.points.after)
    assert len(tunnel.after.views) == len(made.views.after) and warehouse.after.views is None


def by_truth(changed: bool) -> SurveyedPair:
    return changed_pair("hall") if changed else simulated("hall", 1, 5_000, changed=False)


def test_large_files_are_scans_in_survey_coordinates(tmp_path, monkeypatch, capsys):
    paths = [tmp_path / "before it.laz", tmp_path / "after it.laz"]
    monkeypatch.setattr("sys.argv", ["surveyor", "make-large", *map(str, paths), "--points", "4000"])
    __main__.main()
    clouds = [read_cloud(path) for path in paths]
    assert [cloud.crs for cloud in clouds] == ["EPSG:25832", "EPSG:25832"]
    assert [cloud.unit for cloud in clouds] == ["m", "m"]
    assert clouds[0].points[:, 1].min() > 5.4e6
    assert f"{len(clouds[0].points):,} points" in capsys.readouterr().out
    with laspy.open(paths[0]) as file:
        assert file.header.point_count == len(clouds[0].points)


def test_large_scenes_stand_side_by_side(tmp_path):
    paths = Pair(tmp_path / "before.las", tmp_path / "after.las")
    counts = write_large(paths, 8000, copies=2)
    points = read_cloud(paths.before).points
    assert counts.before == len(points)
    far = points[:, 1] > np.median(points[:, 1])
    np.testing.assert_allclose(
        points[far] - points[~far], np.broadcast_to([0, 90, 0], (len(points) // 2, 3)), atol=1e-4
    )


def test_a_change_of_a_large_pair_is_found_in_the_copy_where_it_is_reported(tmp_path):
    pair, steps = changed_pair("hall"), np.array([[0.0, 0, 0], [0, 90, 0]])
    places = [
        points[truth == number][0]
        for points, truth in zip(pair.points, pair.truth, strict=True)
        for number in np.unique(truth[truth >= 0])
    ]
    reported = [*places, places[0] + steps[1], places[0] + [0, 0, 40]]
    lines = ["centre_x,centre_y,centre_z", *(",".join(map(str, place)) for place in reported)]
    (tmp_path / "changes.csv").write_text("\n".join(lines))
    text = found_in_large(tmp_path / "changes.csv", pair, steps, near=0.001)
    assert text == f"{len(places) + 1} of {2 * len(places)} changes reported; 1 of {len(places) + 2} reported are none"
