import base64
import dataclasses
import json
import re
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from gmmjax.reporting.octree import morton_codes, octree_bytes, parting_levels
from gmmjax.reporting.packed_points import NO_LABEL, packed_scene, shown_range
from tests.reporting.conftest import change, labelled

SURVEY = np.array([4.5e5, 5.2e6, 300.0])


def octree_leaves(data, depth, count):
    """What the viewer does: the lattice places of the leaves, and how many bytes the octree took."""
    nodes, read = np.zeros((min(count, 1), 3), int), 0
    for _ in range(depth):
        occupied = np.unpackbits(data[read : read + len(nodes), None], axis=1, bitorder="little").astype(bool)
        read += len(nodes)
        children = np.array([[child & 1, child >> 1 & 1, child >> 2] for child in range(8)])
        nodes = (2 * nodes[:, None] + children)[occupied]
    return nodes, read


def decoded(packed, side):
    """Positions in the frame of the clouds, and the planes by name."""
    scene, record = packed.scene, packed.scene[side]
    data = np.frombuffer(zlib.decompress(base64.b64decode(getattr(packed.points, side))), np.uint8)
    lattice, count = scene["quantisation"], record["drawn"]
    steps, read = octree_leaves(data, lattice["depth"], count)
    points = np.array(scene["origin"]) + np.array(lattice["lower"]) + (steps + 0.5) * lattice["step"]
    planes = dict(zip(record["attributes"], data[read:].reshape(-1, count), strict=True))
    return points, planes


def labels_of(planes):
    labels = planes["labelLow"].astype(int) + 256 * planes["labelHigh"].astype(int)
    return np.where(labels == NO_LABEL, -1, labels)


def cumulative(plane):
    return np.cumsum(plane.astype(int)).astype(np.uint8)


def nearest(points, others):
    from scipy.spatial import cKDTree

    return cKDTree(others).query(points, p=np.inf)


def surveyed(pair, distance=False):
    """The pair far from the origin, as surveys are, as the report gets it."""
    before, after, changes = pair
    clouds = Pair(before, after).map(lambda cloud: dataclasses.replace(cloud, points=cloud.points + SURVEY))
    items = tuple(
        change(item.kind, clouds.before.points[:50] if item.kind == "disappeared" else clouds.after.points[:60])
        for item in changes
    )
    changes = dataclasses.replace(changes, items=items)
    if distance:
        random = np.random.default_rng(2)
        distances = [random.normal(0, 0.1, len(cloud)) for cloud in clouds]
        distances[0][3] = np.nan
        changes = dataclasses.replace(changes, distance_before=distances[0], distance_after=distances[1])
    return clouds, changes


@given(st.integers(0, 12), st.data())
def test_octree_keeps_places(depth, data):
    places = st.tuples(*[st.integers(0, 2**depth - 1)] * 3)
    steps = np.array(data.draw(st.lists(places, max_size=60))).reshape(-1, 3).astype(np.int64)
    codes = np.unique(morton_codes(steps))
    leaves, _ = octree_leaves(octree_bytes(codes, depth), depth, len(codes))
    np.testing.assert_array_equal(np.unique(leaves, axis=0), np.unique(steps, axis=0))
    np.testing.assert_array_equal(morton_codes(leaves), codes)


def test_morton_codes_hold_16_bits_of_each_axis():
    steps = np.random.default_rng(0).integers(0, 2**16, (20, 3))
    digits = [zip(*(f"{step:016b}" for step in reversed(row)), strict=True) for row in steps]
    assert morton_codes(steps).tolist() == [int("".join(bit for bits in row for bit in bits), 2) for row in digits]
    assert morton_codes(np.full((1, 3), 2**16 - 1)) == 2**48 - 1


def test_points_part_where_their_cells_differ():
    codes = np.sort(morton_codes(np.random.default_rng(1).integers(0, 2**5, (300, 3))))
    levels = parting_levels(codes, 5)
    for level in range(6):
        assert (levels <= level).sum() == len(np.unique(codes >> np.uint64(3 * (5 - level))))


def test_positions_and_attributes_return(pair):
    clouds, changes = surveyed(pair, distance=True)
    packed = packed_scene(clouds, changes)
    limit = packed.scene["distanceLimit"]
    for side in ("before", "after"):
        cloud = getattr(clouds, side)
        own = {name: getattr(changes, f"{name}_{side}") for name in ("labels", "probability", "unobserved", "distance")}
        points, planes = decoded(packed, side)
        gap, index = nearest(points, cloud.points)
        assert gap.max() <= packed.scene["quantisation"]["step"] / 2 + 1e-9
        np.testing.assert_array_equal(labels_of(planes), own["labels"][index])
        np.testing.assert_array_equal(planes["unobserved"], own["unobserved"][index])
        assert np.abs(planes["probability"] / 31 - own["probability"][index]).max() <= 0.5 / 31 + 1e-9
        measured = np.where(planes["distance"] == 0, np.nan, (planes["distance"] - 32.0) / 31 * limit)
        expected = np.clip(own["distance"][index], -limit, limit)
        np.testing.assert_allclose(measured, expected, atol=0.5 / 31 * limit + 1e-12)


def test_colors_return_within_a_few_levels(pair):
    clouds, changes = surveyed(pair)
    points, planes = decoded(packed_scene(clouds, changes), "before")
    brightness = cumulative(planes["brightness"]).astype(int) * 4 + 2
    orange, green = (cumulative(planes[name]).view(np.int8).astype(int) * 4 + 2 for name in ("orange", "green"))
    colors = np.stack([brightness - green + orange, brightness + green, brightness - green - orange], axis=1)
    expected = clouds.before.colors[nearest(points, clouds.before.points)[1]].astype(int)
    assert np.abs(colors - expected).max() <= 8
    assert "brightness" not in packed_scene(clouds, changes).scene["after"]["attributes"]


@pytest.mark.parametrize("field", ["intensity", "scalar_Reflectance"])
def test_an_intensity_that_is_the_same_everywhere_is_none(pair, field):
    """As in LAS files of scanners that measure none."""
    clouds, changes = surveyed(pair)
    plain = clouds.map(lambda cloud: dataclasses.replace(cloud, colors=None, fields={}))
    same = plain.map(lambda cloud: dataclasses.replace(cloud, fields={field: np.zeros(len(cloud), np.uint16)}))
    assert packed_scene(same, changes) == packed_scene(plain, changes)
    assert not packed_scene(same, changes).scene["has"]["scan"]


def test_intensity_is_shown_as_grey_where_there_are_no_colors(pair):
    clouds, changes = surveyed(pair)
    intensity = np.linspace(0, 60_000, len(clouds.after)).astype(np.uint16)
    after = dataclasses.replace(clouds.after, fields={"scalar_Intensity": intensity})
    packed = packed_scene(Pair(clouds.before, after), changes)
    points, planes = decoded(packed, "after")
    assert {"brightness"} == {"brightness", "orange", "green"} & set(planes)
    brightness = cumulative(planes["brightness"])
    index = nearest(points, after.points)[1]
    assert np.corrcoef(brightness, index)[0, 1] > 0.99
    assert packed.scene["has"]["scan"]


def test_the_same_clouds_give_the_same_bytes(pair):
    clouds, changes = surveyed(pair)
    assert packed_scene(clouds, changes, 200) == packed_scene(clouds, changes, 200)


@pytest.mark.parametrize("most", [1, 30, 120, 399, 400])
def test_points_of_changes_are_left_out_last(pair, most):
    clouds, changes = surveyed(pair)
    packed = packed_scene(clouds, changes, most)
    for side, cloud in zip(("before", "after"), clouds, strict=True):
        labels = labels_of(decoded(packed, side)[1])
        changed = int((getattr(changes, f"labels_{side}") >= 0).sum())
        # Two of so many may share a place of the lattice.
        assert packed.scene[side]["drawn"] == len(labels) == pytest.approx(min(most, len(cloud)), abs=2 * (most > 300))
        assert (labels >= 0).sum() == min(changed, most)


def test_thinning_is_even(pair):
    """Of a dense and a sparse part, the sparse one keeps its points."""
    random = np.random.default_rng(3)
    dense, sparse = (random.uniform(0, 1, (count, 3)) * [1, 1, 0] for count in (9_000, 1_000))
    cloud = PointCloud.from_rows(np.concatenate([dense, sparse + np.array([2, 0, 0])]))
    changes = labelled(pair[2], np.full(10_000, -1), np.full(10_000, -1), ())
    points, _ = decoded(packed_scene(Pair(cloud, cloud), changes, 1_500), "after")
    assert len(points) == pytest.approx(1_500, abs=30)
    assert (points[:, 0] > 1.5).mean() > 0.25


def test_a_change_keeps_a_place_that_it_shares(pair):
    points = np.zeros((4, 3)) + SURVEY
    cloud = PointCloud.from_rows(points + np.array([[0], [0], [1], [1]]))
    changes = labelled(
        pair[2], np.array([-1, 0, -1, -1]), np.full(4, -1), (change("disappeared", pair[0].points[:9] + SURVEY),)
    )
    labels = labels_of(decoded(packed_scene(Pair(cloud, cloud), changes), "before")[1])
    assert sorted(labels) == [-1, 0]


def test_stray_points_do_not_coarsen_the_lattice(pair):
    clouds, changes = surveyed(pair)
    step = packed_scene(clouds, changes).scene["quantisation"]["step"]
    random = np.random.default_rng(4)
    many = np.concatenate([random.uniform(-3, 3, (5_000, 3)) + SURVEY, [SURVEY + 1e7]])
    far = labelled(changes, np.full(len(many), -1), np.full(500, -1), ())
    packed = packed_scene(Pair(PointCloud.from_rows(many), clouds.after), far)
    assert packed.scene["quantisation"]["step"] < 10 * step
    assert packed.scene["before"]["count"] == packed.scene["before"]["drawn"] + 1


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.full((5, 3), 1e6), np.arange(9.0).reshape(3, 3) * 1e-9])
def test_smallest_clouds(pair, points):
    cloud = PointCloud.from_rows(points)
    unchanged = labelled(pair[2], np.full(len(points), -1), np.full(len(points), -1), ())
    packed = packed_scene(Pair(cloud, cloud), unchanged)
    found, _ = decoded(packed, "after")
    assert nearest(found, points)[0].max() <= packed.scene["quantisation"]["step"]
    assert packed.scene["changes"] == []


def test_all_of_the_scene_is_relative_to_its_origin(pair):
    """Nothing but the origin needs the digits of survey coordinates."""
    clouds, changes = surveyed(pair)
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    turn[:3, 3] = SURVEY - turn[:3, :3] @ SURVEY + [1, 2, 3]
    items = tuple(dataclasses.replace(item, transform=turn) for item in changes)
    scene = packed_scene(clouds, dataclasses.replace(changes, items=items)).scene
    origin = np.array(scene.pop("origin"))
    numbers = re.findall(r"(?<![#\w])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", json.dumps(scene, allow_nan=False))
    assert max(abs(float(number)) for number in numbers) < 1e3
    for record, item in zip(scene["changes"], items, strict=True):
        np.testing.assert_allclose(record["centre"] + origin, item.box.centre, atol=1e-9)
        np.testing.assert_allclose(record["mean"] + origin, item.mean, atol=1e-9)
        moved = np.array(record["transform"])
        point = np.array([0.3, -0.2, 0.1])
        np.testing.assert_allclose(
            moved[:3, :3] @ point + moved[:3, 3] + origin, turn[:3, :3] @ (point + origin) + turn[:3, 3], atol=1e-8
        )


def test_what_the_page_is_told(pair, explained):
    clouds, changes = Pair(*pair[:2]), explained
    scene = packed_scene(clouds, dataclasses.replace(changes, unit="mm")).scene
    assert scene["unit"] == "mm"
    assert scene["has"] == {"scan": True, "distance": False, "unobserved": True}
    assert scene["distanceLimit"] is None
    assert [(item["kind"], item["side"]) for item in scene["changes"]] == [
        ("disappeared", "before"),
        ("moved", "after"),
        ("appeared", "after"),
    ]
    assert {item["reason"] for item in scene["rejected"]} == {"unchanged", "not observed"}
    assert np.allclose(np.linalg.norm(scene["towardsEye"]), 1)


def test_stations_are_where_the_registered_scans_have_them(pair):
    """Those of the after scan are recognised in its own frame."""
    clouds, changes = Pair(*pair[:2]), pair[2]
    transform = np.eye(4)
    transform[:3, 3] = 10.0, 0.0, 0.0
    diagnostics = {
        "before": {"recognised_stations": [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]},
        "after": {"recognised_stations": [[1.0, 2.0, 3.0]]},
    }
    registration = dataclasses.replace(changes.registration, applied=True, transform=transform)
    shown = packed_scene(clouds, dataclasses.replace(changes, diagnostics=diagnostics, registration=registration)).scene
    assert [(own["side"], own["number"]) for own in shown["stations"]] == [("before", 1), ("before", 2), ("after", 1)]
    positions = np.array([own["position"] for own in shown["stations"]]) + shown["origin"]
    np.testing.assert_allclose(positions, [[1, 2, 3], [4, 5, 6], [11, 2, 3]])


def test_two_million_points_fit_a_page(pair):
    """By a tenth of them: walls, a floor and things, with noise in everything that is stored."""
    random = np.random.default_rng(5)
    count = 100_000
    walls = random.uniform(-0.5, 0.5, (count, 3)) * [36, 22, 7]
    flat = random.integers(0, 3, count)
    walls[np.arange(count), flat] = np.sign(walls[np.arange(count), flat]) * np.array([18, 11, 3.5])[flat]
    points = walls + random.normal(0, 0.003, walls.shape)
    colors = np.clip(120 + 20 * np.sin(points) + random.normal(0, 8, (count, 1)), 0, 255).astype(np.uint8)
    cloud = PointCloud.from_rows(points + SURVEY, colors=colors)
    labels = np.where(np.linalg.norm(points - [18, 0, 0], axis=1) < 1, 0, -1)
    changes = labelled(pair[2], labels, labels, (change("disappeared", cloud.points[labels == 0]),))
    noise = random.normal(0, 0.003, count)
    probability = np.clip(random.exponential(0.02, count), 0, 1)
    changes = dataclasses.replace(
        changes,
        distance_before=noise,
        distance_after=noise,
        probability_before=probability,
        probability_after=probability,
        unobserved_before=points[:, 0] > 10,
        unobserved_after=points[:, 1] > 5,
    )
    packed = packed_scene(Pair(cloud, cloud), changes)
    bytes_a_point = len(packed.points.before) / packed.scene["before"]["drawn"]
    assert packed.scene["before"]["drawn"] > 0.95 * count
    # 2 million of them, beside 0.6 MB of script: under 12 MB.
    assert bytes_a_point < 5


def test_one_stray_point_does_not_shrink_the_view(pair):
    before, _, changes = pair
    points = np.concatenate([np.repeat(before.points, 5, axis=0), [[1e4, 0, 0]]])
    lower, upper = shown_range(points, changes)
    assert (upper - lower).max() < 20
    assert (lower < before.points.min(axis=0)).all()
