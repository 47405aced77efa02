import contextlib
import dataclasses
import errno
import io
import os

import laspy
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.changes.registration import Registration
from gmmjax.clouds import (
    FolderKind,
    PointCloud,
    open_cloud,
    open_survey,
    output_folder,
    read_cloud,
    read_layout,
    read_survey,
    write_pcd,
    write_ply,
)
from gmmjax.errors import InputError, InputWarning
from gmmjax.geometry.rigid import rigid_transform, transformed
from gmmjax.pair import Pair
from gmmjax.reporting import write_scan
from gmmjax.reporting.labelled_cloud import LabelledCloud, labelled_clouds, labelled_files, write_scans
from gmmjax.reporting.result_folder import result_files, write_result
from tests.clouds.formats import WRITERS, write_all
from tests.clouds.las_files import GEOTIFF, las_bytes, parsed, vlr

QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
FOUND = ["label", "kind", "probability", "unobserved", "distance", "level_of_detection", "significance"]
MOTION = rigid_transform(QUARTER, np.array([10.0, 0.0, 0.5]))


@pytest.fixture
def turned(pair):
    """The changes with an after cloud that was turned by 90 degrees, and distances that are not all known."""
    return dataclasses.replace(
        pair[2],
        registration=Registration(MOTION, True, 2.0, 0.01, 0.5, 0.9),
        distance_before=np.where(np.arange(400) % 2, np.nan, 0.25),
        distance_after=np.linspace(-1, 1, 500),
        level_of_detection_before=np.where(np.arange(400) % 2, np.nan, 0.125),
        level_of_detection_after=np.full(500, 0.01),
        significance_before=np.where(np.arange(400) % 2, np.nan, 3.92),
        significance_after=np.linspace(0, 196, 500),
    )


def written(clouds, changes, folder, transform=MOTION):
    """Both scans as they are written, by name."""
    folder.mkdir()
    labelled = labelled_clouds(clouds, changes, transform)
    return [own.write(folder, side) for side, own in zip(("before", "after"), labelled, strict=True)]


@pytest.fixture
def ply(pair, tmp_path):
    """An after scan with normals, intensity and names that PLY or a result have already."""
    generator = np.random.default_rng(3)
    fields = {
        "nx": np.ones(500, np.float32),
        "ny": np.zeros(500, np.float32),
        "nz": np.zeros(500, np.float32),
        "intensity": generator.random(500),
        "scalar_GPS-Time": np.arange(500, dtype=np.int32),
        "label": np.full(500, 7, np.int32),
    }
    colors = generator.integers(0, 256, (500, 3), dtype=np.uint8)
    write_ply(tmp_path / "scan.ply", pair[1].points, colors=colors, fields=fields)
    return read_cloud(tmp_path / "scan.ply")


def test_ply_keeps_fields_colours_and_normals(pair, ply, turned, tmp_path):
    names = written(Pair(pair[0], ply), turned, tmp_path / "out")
    assert names == ["before.ply", "after.ply"]
    cloud = read_cloud(tmp_path / "out" / "after.ply")
    np.testing.assert_allclose(cloud.points, ply.points @ QUARTER.T + [10, 0, 0.5])
    assert [cloud.fields[name][0] for name in ("nx", "ny", "nz")] == [0, 1, 0]
    for name in ("intensity", "scalar_GPS-Time"):
        np.testing.assert_array_equal(cloud.fields[name], ply.fields[name])
    np.testing.assert_array_equal(cloud.fields["label"], turned.labels_after)
    assert (cloud.fields["input_label"] == 7).all()
    scan = np.stack([cloud.fields[f"scan_{channel}"] for channel in ("red", "green", "blue")], axis=1)
    np.testing.assert_array_equal(scan, ply.colors)
    np.testing.assert_array_equal(cloud.fields["kind"][[0, 60, 400]], [3, 1, 0])
    before = read_cloud(tmp_path / "out" / "before.ply")
    for name in ("distance", "level_of_detection", "significance"):
        np.testing.assert_allclose(cloud.fields[name], getattr(turned, f"{name}_after"), rtol=1e-6)
        assert np.isnan(before.fields[name][1]) and np.isfinite(before.fields[name][0])


def test_ply_is_read_by_another_library(pair, ply, turned, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    written(Pair(pair[0], ply), turned, tmp_path / "out")
    cloud = trimesh.load(tmp_path / "out" / "after.ply")
    vertex = cloud.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(vertex["label"].ravel(), turned.labels_after)
    np.testing.assert_allclose(vertex["distance"].ravel(), turned.distance_after, rtol=1e-6)
    np.testing.assert_array_equal(cloud.colors[0][:3], [0x00, 0x72, 0xB2])


def test_names_of_other_scripts_and_whole_numbers_of_64_bits(pair, turned, tmp_path):
    fields = {"größe (m)": np.arange(500.0), "_": np.arange(500), "id": np.full(500, 2**40), "red": np.zeros(500)}
    after = dataclasses.replace(pair[1], fields=fields)
    written(Pair(pair[0], after), turned, tmp_path / "out")
    cloud = read_cloud(tmp_path / "out" / "after.ply")
    assert {"gr__e__m_", "field__", "input_red"} <= set(cloud.fields)
    assert (cloud.fields["id"] == 2**40).all()
    after = dataclasses.replace(pair[1], fields={"id": np.full(500, 2**60 + 1)})
    with pytest.warns(InputWarning, match="field 'id' runs from .* it is rounded to float64"):
        written(Pair(pair[0], after), turned, tmp_path / "again")


def test_pcd_keeps_fields_order_and_viewpoint(pair, turned, tmp_path):
    image = np.full((20, 26, 3), np.nan, np.float32)
    image.reshape(-1, 3)[:500] = pair[1].points
    curvature = np.arange(520.0).reshape(20, 26).astype(np.float32)
    viewpoint = (1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0)
    write_pcd(tmp_path / "scan.pcd", image, viewpoint=viewpoint, fields={"curvature": curvature})
    after = read_cloud(tmp_path / "scan.pcd")
    assert written(Pair(pair[0], after), turned, tmp_path / "out") == ["before.ply", "after.pcd"]
    layout, cloud = read_layout(tmp_path / "out" / "after.pcd"), read_cloud(tmp_path / "out" / "after.pcd")
    assert (layout.grid, layout.dtype) == ((20, 26), np.float32)
    np.testing.assert_allclose(layout.pose, MOTION @ rigid_transform(translation=np.array([1.0, 2.0, 3.0])), atol=1e-12)
    np.testing.assert_allclose(cloud.points, after.points @ QUARTER.T + [10, 0, 0.5], atol=1e-5)
    np.testing.assert_array_equal(cloud.rows, after.rows)
    np.testing.assert_array_equal(cloud.fields["curvature"], np.arange(500))
    np.testing.assert_array_equal(cloud.fields["label"], turned.labels_after)


@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_pcd_keeps_its_coordinates_and_viewpoint(pair, turned, tmp_path, kind):
    """In every bit: the viewpoint, too, which a matrix in between would round."""
    quaternion = Rotation.random(rng=4).as_quat() * (1 + 3e-8)
    viewpoint = (1 / 3, 2.0, 5_849_137.125, *(float(number) for number in quaternion))
    points = (pair[1].points + 1 / 3).astype(kind)
    write_pcd(tmp_path / "scan.pcd", points, viewpoint=viewpoint, fields={"normal_x": np.ones(500)})
    folder = write_result(tmp_path / "result", pair[0], read_cloud(tmp_path / "scan.pcd"), turned)
    cloud, layout = read_cloud(folder / "after.pcd"), read_layout(folder / "after.pcd")
    np.testing.assert_array_equal(cloud.points, points)
    assert (layout.viewpoint, layout.dtype) == (viewpoint, np.dtype(kind))


def test_pcd_with_axes_of_several_types(pair, turned, tmp_path):
    """The widest holds them all."""
    rows = np.zeros(500, [("x", "<f4"), ("y", "<f8"), ("z", "<i4")])
    rows["x"], rows["y"], rows["z"] = 0.1, np.linspace(5e6, 5e6 + 1, 500), np.arange(500)
    head = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 8 4\nTYPE F F I\nCOUNT 1 1 1\nWIDTH 500\nHEIGHT 1\nPOINTS 500\nDATA binary\n"
    )
    (tmp_path / "scan.pcd").write_bytes(head.encode() + rows.tobytes())
    after = read_cloud(tmp_path / "scan.pcd")
    folder = write_result(tmp_path / "result", pair[0], after, turned)
    np.testing.assert_array_equal(read_cloud(folder / "after.pcd").points, after.points)


def test_pcd_is_read_by_another_library(pair, turned, tmp_path):
    pypcd4 = pytest.importorskip("pypcd4")
    write_pcd(
        tmp_path / "scan.pcd", pair[1].points.astype(np.float32), fields={"ring": np.arange(500, dtype=np.uint16)}
    )
    written(Pair(pair[0], read_cloud(tmp_path / "scan.pcd")), turned, tmp_path / "out")
    cloud = pypcd4.PointCloud.from_path(tmp_path / "out" / "after.pcd")
    np.testing.assert_array_equal(cloud.pc_data["label"], turned.labels_after)
    np.testing.assert_array_equal(cloud.pc_data["ring"], np.arange(500))
    np.testing.assert_allclose(cloud.pc_data["significance"], turned.significance_after, rtol=1e-6)


@pytest.fixture
def las(tmp_path):
    """An after scan of 500 points in metres."""
    path = tmp_path / "scan <1>.las"
    path.write_bytes(
        las_bytes(4, 7, count=500, vlrs=(vlr(b"LASF_Projection", 34735, GEOTIFF),), offset=(0.0, 0.0, 0.0))
    )
    return path


def test_las_keeps_all_and_gets_dimensions(pair, turned, las, tmp_path):
    folder = write_result(tmp_path / "result", pair[0], read_cloud(las), turned, transform_after=True)
    assert [name for name in result_files(folder) if name.startswith(("before", "after"))] == [
        "before.ply",
        "after.las",
    ]
    old, new, read = (
        parsed(las.read_bytes()),
        parsed((folder / "after.las").read_bytes()),
        laspy.read(folder / "after.las"),
    )
    np.testing.assert_array_equal(new["rows"][:, 12:36], old["rows"][:, 12:])
    np.testing.assert_allclose(new["points"], old["points"] @ QUARTER.T + [10, 0, 0.5], atol=0.000501)
    assert new["records"][0] == old["records"][0]
    for name in FOUND:
        np.testing.assert_array_equal(read[name], new["extra"][name.encode()])
    np.testing.assert_array_equal(read.label, turned.labels_after)
    np.testing.assert_array_equal(read.unobserved, turned.unobserved_after)
    for name in FOUND[4:]:
        np.testing.assert_allclose(read[name], getattr(turned, f"{name}_after"), rtol=1e-6)
    described = {dimension.name: dimension.description for dimension in read.point_format.extra_dimensions}
    assert described["level_of_detection"] == "distance significant at 95 %"


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_las_keeps_its_coordinates(pair, turned, las, tmp_path, ending):
    """Integers, scale and offset are those of the file."""
    source = las
    if ending == "laz":
        source = tmp_path / "scan.laz"
        laspy.read(las).write(source)
    folder = write_result(tmp_path / "result", pair[0], read_cloud(source), turned)
    old, new = laspy.read(source), laspy.read(folder / f"after.{ending}")
    for axis in "XYZ":
        np.testing.assert_array_equal(new[axis], old[axis])
    with source.open("rb") as before, (folder / f"after.{ending}").open("rb") as after:
        assert before.read(227)[131:179] == after.read(227)[131:179]


def test_a_result_is_an_input_again(pair, turned, las, tmp_path):
    first = write_result(tmp_path / "first", pair[0], read_cloud(las), turned)
    second = write_result(tmp_path / "second", pair[0], read_cloud(first / "after.las"), turned)
    dimensions = list(laspy.read(second / "after.las").point_format.extra_dimension_names)
    assert dimensions == [*(f"input_{name}" for name in FOUND), *FOUND]


def test_a_file_that_is_gone_gives_ply_and_a_warning(pair, turned, las, tmp_path):
    after = read_cloud(las)
    las.unlink()
    with pytest.warns(InputWarning, match=r"scan <1>\.las: .*; after\.ply is written in place of after\.las"):
        folder = write_result(tmp_path / "result", pair[0], after, turned)
    assert "intensity" in read_cloud(folder / "after.ply").fields


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_a_disk_that_fills_leaves_no_result(pair, turned, las, tmp_path, monkeypatch, ending):
    source = tmp_path / f"scan.{ending}"
    laspy.read(las).write(source)
    after = read_cloud(source)

    class Full(io.FileIO):
        def write(self, content):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    @contextlib.contextmanager
    def full(path):
        with Full(path, "wb") as file:
            yield file

    monkeypatch.setattr("gmmjax.clouds.las_writing.atomic_write", full)
    with pytest.raises(InputError, match=r"result: cannot be written \(No space left"):
        write_result(tmp_path / "result", pair[0], after, turned)
    assert not (tmp_path / "result").exists()


def test_a_result_in_another_format_replaces_the_old_files(pair, turned, las, tmp_path):
    folder = write_result(tmp_path / "result", pair[0], read_cloud(las), turned)
    plain = PointCloud.from_rows(pair[1].points)
    write_result(folder, pair[0], plain, turned, overwrite=True)
    assert not (folder / "after.las").exists()
    assert (folder / "after.ply").exists()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    write_all(folder)
    return folder


def found_about(count):
    labels = np.random.default_rng(0).integers(-1, 3, count).astype(np.int32)
    return {
        "label": labels,
        "kind": (labels + 1).astype(np.uint8),
        "probability": labels.astype(np.float32),
        "unobserved": (labels > 1).astype(np.uint8),
        "distance": np.arange(count, dtype=np.float32),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("transform", [None, MOTION], ids=["still", "moved"])
def test_a_file_in_chunks_gives_what_a_cloud_in_memory_gives(files, tmp_path, monkeypatch, name, transform):
    """Whatever the size of the blocks that are read, of the chunks that are written, and of the results in memory."""
    cloud, file = read_cloud(files / name), open_cloud(files / name)
    found = found_about(file.count)
    of_points = {key: values[cloud.rows] for key, values in found.items()}
    in_memory = LabelledCloud(cloud, of_points, transform).write(tmp_path, "memory")
    for key, values in found.items():
        np.save(tmp_path / f"{key}.npy", values)
    on_disk = {key: np.load(tmp_path / f"{key}.npy", mmap_mode="r") for key in found}
    monkeypatch.setattr("gmmjax.clouds.records.BLOCK", 400)
    monkeypatch.setattr("gmmjax.clouds.cloud_file.CloudFile.clouds.__defaults__", (5,))
    in_chunks = LabelledCloud(file, on_disk, transform).write(tmp_path, "chunks")
    assert (tmp_path / in_chunks).read_bytes() == (tmp_path / in_memory).read_bytes()


def test_points_that_move_out_of_the_range_of_their_file(files, tmp_path):
    """The offset gives way, for a cloud in memory as for one in its file."""
    cloud, file = read_cloud(files / "a.las"), open_cloud(files / "a.las")
    motion = rigid_transform(translation=np.array([4e6, 0.0, 0.0]))
    found = found_about(file.count)
    names = [LabelledCloud(own, found, motion).write(tmp_path, f"b{place}") for place, own in enumerate((cloud, file))]
    assert (tmp_path / names[0]).read_bytes() == (tmp_path / names[1]).read_bytes()
    np.testing.assert_allclose(read_cloud(tmp_path / names[0]).points, transformed(cloud.points, motion), atol=0.001)


@pytest.mark.parametrize("name", ["a.las", "a.laz", "a.e57", "a.ply", "a.pcd"])
def test_a_disk_that_fills_in_the_middle_of_a_file(files, tmp_path, monkeypatch, name):
    resource = pytest.importorskip("resource")
    file = open_cloud(files / name)
    monkeypatch.setattr("gmmjax.clouds.cloud_file.CloudFile.clouds.__defaults__", (5,))
    kind = FolderKind("result", "marker.json", "changes", ())
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        with pytest.raises(InputError, match="out <1>: cannot be written"):
            with output_folder(tmp_path / "out <1>", kind) as folder:
                # Writing beyond it fails as on a full disk.
                resource.setrlimit(resource.RLIMIT_FSIZE, (700, limits[1]))
                LabelledCloud(file, found_about(file.count), MOTION).write(folder, "after")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_each_scan_of_a_survey_is_written_as_alone(files, tmp_path):
    """In memory, from its files, and as the one scan of a result."""
    paths = [files / name for name in ("a.las", "a.ply", "b.pcd", "a.npy")]
    survey, cloud = open_survey(paths), read_survey(paths)
    found = found_about(survey.count)
    of_points = {key: values[cloud.rows] for key, values in found.items()}
    for name in ("memory", "files", "alone"):
        (tmp_path / name).mkdir()
    names = write_scans(tmp_path / "memory", "after", LabelledCloud(cloud, of_points, MOTION).by_file())
    assert names == ["after/a.las", "after/a-2.ply", "after/b.pcd", "after/a-3.ply"]
    assert write_scans(tmp_path / "files", "after", labelled_files(survey, found, MOTION)) == names
    for index, (name, path) in enumerate(zip(names, paths, strict=True)):
        rows = survey.rows_of(index)
        own = {key: values[rows][read_cloud(path).rows] for key, values in found.items()}
        alone = LabelledCloud(read_cloud(path), own, MOTION)
        (written,) = write_scans(tmp_path / "alone", f"{index}", alone.by_file())
        expected = (tmp_path / "alone" / written).read_bytes()
        assert (tmp_path / "memory" / name).read_bytes() == expected
        assert (tmp_path / "files" / name).read_bytes() == expected


@pytest.mark.parametrize("name", WRITERS)
def test_further_values_of_a_scan(files, tmp_path, name):
    """Of any names; colours and fields are those of the scan."""
    file, cloud = open_cloud(files / name), read_cloud(files / name)
    columns = {"distance": np.arange(file.count, dtype=np.float32), "a": np.arange(file.count, dtype=np.int16)}
    ending = file.path.suffix if file.path.suffix in (".las", ".laz", ".pcd") else ".ply"
    again = read_cloud(write_scan(tmp_path / f"out{ending}", file, columns))
    np.testing.assert_array_equal(again.points, cloud.points)
    np.testing.assert_array_equal(again.colors, cloud.colors)
    assert not {"kind", "label", "scan_red"} & set(again.fields)
    if ending in (".las", ".laz"):
        values = laspy.read(tmp_path / f"out{ending}")
        np.testing.assert_array_equal(values["distance"], columns["distance"][cloud.rows])
    else:
        np.testing.assert_array_equal(again.fields["distance"], columns["distance"][cloud.rows])
        np.testing.assert_array_equal(again.fields["a"], columns["a"][cloud.rows])
        assert ("input_a" in again.fields) == ("a" in cloud.fields)


def test_values_that_cannot_be_written(files, tmp_path):
    file = open_cloud(files / "a.laz")
    with pytest.raises(InputError, match=r"column 'a' must be whole or real numbers \[57\].* not float64 \[3\]"):
        write_scan(tmp_path / "out.laz", file, {"a": np.zeros(3)})
    with pytest.raises(InputError, match=r"not bool \[57\]"):
        write_scan(tmp_path / "out.laz", file, {"a": np.zeros(57, bool)})
    with pytest.raises(InputError, match=r"a result of a\.laz is a \.laz file; name it out\.laz"):
        write_scan(tmp_path / "out.ply", file, {"a": np.zeros(57)})
    with pytest.raises(InputError, match="nowhere"):
        write_scan(tmp_path / "nowhere" / "out.laz", file, {"a": np.zeros(57)})
    assert not list(tmp_path.iterdir())
