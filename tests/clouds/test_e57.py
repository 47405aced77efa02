import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.changes.evidence.view_checks import check_views
from gmmjax.clouds import open_cloud, read_cloud
from gmmjax.clouds.e57 import CARTESIAN
from gmmjax.clouds.reference_system import ReferenceSystem
from gmmjax.errors import InputError

pye57 = pytest.importorskip("pye57")

ROWS, COLUMNS = 40, 60
ROOM = np.array([4.0, 3.0, 1.5])


def station(seed=0):
    """What a turning scanner in the middle of a room sees, in its own frame, with the pose that it has there."""
    generator = np.random.default_rng(seed)
    turn = Rotation.from_euler("z", generator.uniform(0, 6))
    position = generator.uniform(-1, 1, 3)
    rows, columns = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    elevation, azimuth = np.radians(60 - 120 * (rows + 0.5) / ROWS), np.radians(360 * columns / COLUMNS)
    rays = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    in_world = turn.apply(rays)
    with np.errstate(divide="ignore"):
        ranges = ((np.sign(in_world) * ROOM - position) / in_world).min(axis=1)
    places = rays * ranges[:, None]
    data = {axis: places[:, index] for index, axis in enumerate(("cartesianX", "cartesianY", "cartesianZ"))}
    data |= {"rowIndex": rows.astype("H"), "columnIndex": columns.astype("H")}
    data["intensity"] = generator.random(len(rows)).astype("f")
    return data, np.roll(turn.as_quat(), 1), position


def write(path, *scans):
    file = pye57.E57(str(path), mode="w")
    for data, rotation, translation in scans:
        file.write_scan_raw(data, rotation=rotation, translation=translation)
    file.close()
    return path


@pytest.fixture(scope="module")
def two_stations(tmp_path_factory):
    scans = station(0), station(1)
    for channel, (data, *_) in enumerate(scans):
        count = len(data["intensity"])
        data |= {f"color{name}": np.full(count, 50 * channel, "B") for name in ("Red", "Green", "Blue")}
        data["cartesianInvalidState"] = (np.arange(count) % 10 == 3).astype("b")
    return write(tmp_path_factory.mktemp("e57") / "two <stations>.e57", *scans), scans


def test_scans_are_merged_in_the_world(two_stations):
    path, scans = two_stations
    cloud = read_cloud(path)
    half = ROWS * COLUMNS * 9 // 10
    assert (len(cloud), cloud.rows_dropped, cloud.unit) == (2 * half, 2 * ROWS * COLUMNS // 10, "m")
    # All lie on the walls of the one room.
    assert np.abs(np.abs(cloud.points) / ROOM).max(axis=1) == pytest.approx(np.ones(2 * half), abs=1e-5)
    assert cloud.fields["scan"].tolist() == [0] * half + [1] * half
    valid = scans[0][0]["cartesianInvalidState"] == 0
    np.testing.assert_array_equal(cloud.fields["intensity"][:half], scans[0][0]["intensity"][valid])
    assert cloud.colors[0].tolist() == [0, 0, 0] and cloud.colors[-1].tolist() == [50, 50, 50]


def test_poses_of_turning_scanners_are_views(two_stations):
    path, scans = two_stations
    cloud = read_cloud(path)
    assert cloud.views.turning and cloud.views.field_of_view[0] == 360
    np.testing.assert_allclose(cloud.views.poses[:, :3, 3], [scans[0][2], scans[1][2]])
    for view in range(2):
        own = cloud.points[cloud.fields["scan"] == view]
        assert cloud.views.in_field_of_view(cloud.views.in_camera(own, view)).all()
    assert check_views("before", ScanVisibility.of(cloud.points, cloud.views)) is None
    opened = open_cloud(path).views
    assert opened.field_of_view == cloud.views.field_of_view
    np.testing.assert_array_equal(opened.poses, cloud.views.poses)


def test_a_merged_cloud_has_no_views(tmp_path):
    data, rotation, position = station()
    mixed = np.random.default_rng(0).permutation(ROWS * COLUMNS)
    shuffled = {name: values[mixed] if name.startswith("cartesian") else values for name, values in data.items()}
    assert read_cloud(write(tmp_path / "a.e57", (shuffled, rotation, position))).views is None
    bare = {name: values for name, values in data.items() if name.startswith("cartesian")}
    cloud = read_cloud(write(tmp_path / "b.e57", (bare, rotation, position)))
    assert cloud.views is None and cloud.colors is None and not cloud.fields


def test_fields_that_one_scan_lacks_are_nan_there(tmp_path):
    first, second = station(0), station(1)
    del second[0]["intensity"]
    cloud = read_cloud(write(tmp_path / "a.e57", first, second))
    assert np.isnan(cloud.fields["intensity"]).sum() == ROWS * COLUMNS


def structured(path, fields, count, values=None):
    """A file of one scan whose points have any fields, all zero or the columns of `values`."""
    from pye57 import libe57

    file = pye57.E57(str(path), mode="w")
    image = file.image_file
    scan, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
    for name in fields:
        prototype.set(name, libe57.FloatNode(image, 0.0, libe57.E57_DOUBLE, -1e3, 1e3))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan.set("points", points)
    file.data3d.append(scan)
    buffers = libe57.VectorSourceDestBuffer()
    columns = [np.zeros(max(count, 1)) for _ in fields] if values is None else list(np.ascontiguousarray(values.T))
    for name, column in zip(fields, columns, strict=True):
        buffers.append(libe57.SourceDestBuffer(image, name, column, len(column), True, True))
    writer = points.writer(buffers)
    if count:
        writer.write(count)
    writer.close()
    file.close()
    return path


def test_spherical_coordinates_are_converted(tmp_path):
    data, *_ = station()
    places = np.stack([data[axis] for axis in CARTESIAN], axis=1)
    reach = np.linalg.norm(places, axis=1)
    azimuth, elevation = np.arctan2(places[:, 1], places[:, 0]), np.arcsin(places[:, 2] / reach)
    invalid = (np.arange(len(reach)) % 7 == 0).astype(float)
    names = ("sphericalRange", "sphericalAzimuth", "sphericalElevation", "sphericalInvalidState", "rowIndex")
    values = np.stack([reach, azimuth, elevation, invalid, data["rowIndex"]], axis=1)
    cloud = read_cloud(structured(tmp_path / "a.e57", names, len(values), values))
    np.testing.assert_allclose(cloud.points, places[invalid == 0], atol=1e-12)
    assert list(cloud.fields) == ["rowIndex"] and cloud.rows_dropped == int(invalid.sum())


def test_what_cannot_be_used_is_said(tmp_path):
    incomplete = structured(tmp_path / "a.e57", ("sphericalRange", "sphericalAzimuth", "intensity"), 5)
    with pytest.raises(InputError, match="scan 0 of 1 has neither Cartesian nor spherical coordinates, only: sph"):
        read_cloud(incomplete)
    empty = structured(tmp_path / "b.e57", ("cartesianX", "cartesianY", "cartesianZ"), 0)
    with pytest.raises(InputError, match=r"has no points in any of its scans \(1\); export"):
        read_cloud(empty)
    file = pye57.E57(str(tmp_path / "c.e57"), mode="w")
    file.close()
    with pytest.raises(InputError, match="has no scan; export"):
        read_cloud(tmp_path / "c.e57")


@pytest.mark.parametrize("share", [0.001, 0.3, 0.9])
def test_damaged_files(two_stations, write_file, share):
    data = two_stations[0].read_bytes()
    place = int(share * len(data))
    for damaged in (data[:place], data[:place] + b"\xff" * 64 + data[place + 64 :]):
        path = write_file("a.e57", damaged)
        with pytest.raises(InputError) as caught:
            read_cloud(path)
        assert str(path) in str(caught.value)
        assert path.read_bytes() == damaged


def test_a_geographic_system_makes_no_metres(two_stations, monkeypatch):
    """By the standard coordinates are metres; programs write degrees all the same."""
    monkeypatch.setattr("gmmjax.clouds.e57.of_wkt", lambda text: ReferenceSystem("degree", "EPSG:4326"))
    cloud = read_cloud(two_stations[0])
    assert (cloud.unit, cloud.crs) == ("degree", "EPSG:4326")
