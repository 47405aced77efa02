"""Several scans of one survey: one cloud, in memory and in chunks, whose rows are those of the files."""

import numpy as np
import pytest

from gmmjax.clouds import SensorViews, open_cloud, open_survey, read_cloud, read_survey, write_ply
from gmmjax.errors import InputError, InputWarning
from tests.clouds.formats import WRITERS, write_all
from tests.clouds.las_files import GEOTIFF, las_bytes, vlr

# Two files of one scan, and one of two.
NAMES = ("a.las", "a.ply", "a.e57")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    write_all(folder)
    return folder


@pytest.fixture(scope="module")
def paths(files):
    return [files / name for name in NAMES]


def test_rows_are_those_of_the_files_one_after_the_other(paths):
    clouds, survey = [read_cloud(path) for path in paths], open_survey(paths)
    cloud = read_survey(paths)
    np.testing.assert_array_equal(cloud.points, np.concatenate([own.points for own in clouds]))
    assert cloud.rows_dropped == sum(own.rows_dropped for own in clouds)
    assert (survey.count, survey.unit) == (len(cloud) + cloud.rows_dropped, None)
    assert (cloud.source, repr(cloud).count("3 files")) == ("a.las, a.ply, a.e57", 1)
    for size in (1, 37, 1_000):
        points, rows = zip(*survey.chunks(size), strict=True)
        np.testing.assert_array_equal(np.concatenate(points), cloud.points)
        np.testing.assert_array_equal(np.concatenate(rows), cloud.rows)
    for index, own in enumerate(clouds):
        rows = survey.rows_of(index)
        inside = (cloud.rows >= rows.start) & (cloud.rows < rows.stop)
        np.testing.assert_array_equal(cloud.rows[inside] - rows.start, own.rows)


def test_the_points_of_each_file_are_as_they_were_read(paths):
    cloud = read_survey(paths)
    parts = list(cloud.by_file())
    assert len(parts) == 3
    for path, (place, part) in zip(paths, parts, strict=True):
        own = read_cloud(path)
        np.testing.assert_array_equal(part.points, cloud.points[place])
        np.testing.assert_array_equal(part.points, own.points)
        np.testing.assert_array_equal(part.rows, own.rows)
        assert (part.file, part.source, part.rows_dropped) == (own.file, own.source, own.rows_dropped)
        assert list(part.fields) == list(own.fields)
        for name, values in own.fields.items():
            assert part.fields[name].dtype == values.dtype
            np.testing.assert_array_equal(part.fields[name], values)
        assert (part.colors is None) == (own.colors is None)
        np.testing.assert_array_equal(part.colors, own.colors)


def test_what_one_file_lacks(paths):
    cloud = read_survey(paths)
    counts = [len(part) for _, part in cloud.by_file()]
    assert np.isnan(cloud.fields["a"]).sum() == counts[0] + counts[2]
    assert (cloud.colors[counts[0] + counts[1] :] == 128).all()


def test_colours_of_some_rows(paths, tmp_path):
    cloud, survey = read_survey(paths), open_survey(paths)
    chosen = np.random.default_rng(0).permutation(len(cloud))[: len(cloud) // 2]
    np.testing.assert_array_equal(survey.colors_or_intensity(cloud.rows[chosen]), cloud.colors[chosen])
    # Without colours the intensity, which only one of both has.
    np.save(tmp_path / "a.npy", np.zeros((2, 3)))
    write_ply(tmp_path / "b.ply", np.zeros((3, 3)), fields={"intensity": np.array([7.0, 8.0, 9.0])})
    mixed = open_survey([tmp_path / "a.npy", tmp_path / "b.ply"])
    np.testing.assert_array_equal(mixed.colors_or_intensity(np.array([4, 0, 2])), [9, np.nan, 7])
    assert open_survey([tmp_path / "a.npy"]).colors_or_intensity(np.arange(2)) is None


def test_a_survey_of_one_file_is_that_file(files):
    survey, single = read_survey([files / "a.ply"]), read_cloud(files / "a.ply")
    assert survey.file == single.file and not survey.files


def with_system(path, keys):
    path.write_bytes(las_bytes(2, 3, vlrs=(vlr(b"LASF_Projection", 34735, keys),)))
    return path


def test_files_that_do_not_belong_together(files, tmp_path):
    metres = with_system(tmp_path / "metres.las", GEOTIFF)
    feet = with_system(tmp_path / "feet.las", GEOTIFF.replace(np.uint16(9001).tobytes(), np.uint16(9003).tobytes()))
    zone = with_system(tmp_path / "zone.las", GEOTIFF.replace(np.uint16(25832).tobytes(), np.uint16(25833).tobytes()))
    with pytest.raises(InputError, match=r"feet.las: is in ftUS, and .*metres.las in m, .*convert one of them"):
        open_survey([metres, files / "a.ply", feet])
    with pytest.raises(InputError, match=r"zone.las: is in EPSG:25833, and .*metres.las in EPSG:25832, .*reproject"):
        read_survey([metres, zone])
    with pytest.raises(InputError, match=r"a\.ply: is given twice"):
        open_survey([files / "a.ply", files / "a.las", files / ".." / files.name / "a.ply"])
    with pytest.raises(InputError, match="at least one file"):
        open_survey([])
    assert open_survey([metres, files / "a.ply"]).unit is None
    assert open_survey([metres, files / "a.e57"]).unit == "m"


def camera(position):
    return SensorViews(
        [np.block([[np.eye(3), np.array(position)[:, None]], [np.zeros((1, 3)), 1.0]])], (60.0, 40.0), 9.0
    )


def test_views_are_merged():
    turning = SensorViews(camera((5.0, 6.0, 7.0)).poses, (360.0, 90.0), 12.0)
    cameras = SensorViews.merged([camera((1.0, 2.0, 3.0)), camera((3.0, 2.0, 1.0))])
    np.testing.assert_array_equal(cameras.poses[:, :3, 3], [[1, 2, 3], [3, 2, 1]])
    assert (cameras.field_of_view, cameras.max_range) == ((60.0, 40.0), 9.0)
    both = SensorViews.merged([camera((1.0, 2.0, 3.0)), turning])
    np.testing.assert_array_equal(both.poses[:, :3, 3], [[1, 2, 3], [5, 6, 7]])
    np.testing.assert_array_equal(both.poses[1], turning.poses[0])
    assert both.turning and both.field_of_view[1] > 170 and both.max_range == 12
    # The camera has become a scanner that sees what it saw.
    assert both.in_field_of_view(both.in_camera(np.array([[1.5, 2.5, 4.0], [0.9, 2.1, 5.0]]), 0)).all()


@pytest.mark.parametrize("size", [50, 1_000_000])
def test_views_from_parts_are_those_of_all_points(size):
    random = np.random.default_rng(0)
    around, ahead = random.normal(size=(400, 3)), random.uniform((-1, 8, -1), (1, 10, 1), (400, 3))
    for points, turning in ((around, True), (ahead, False)):
        whole = SensorViews.from_positions(points, [[0.0, 0.0, 0.1], [0.2, 0.0, 0.0]])
        parts = [points[start : start + size] for start in range(0, len(points), size)]
        views = SensorViews.from_parts(lambda parts=parts: parts, [[0.0, 0.0, 0.1], [0.2, 0.0, 0.0]])
        assert views.turning == whole.turning == turning
        np.testing.assert_allclose(views.poses, whole.poses, atol=1e-12)
        np.testing.assert_allclose(views.field_of_view, whole.field_of_view, rtol=1e-12)
        assert views.max_range == whole.max_range


def test_survey_coordinates_lose_nothing(files, tmp_path):
    """Shifted by EPSG offsets, the points differ by nothing but float64's rounding of the shift."""
    points = np.random.default_rng(0).uniform(-30, 30, (50, 3))
    offset = np.array([4_500_000.0, 5_400_000.0, 100.0])
    write_ply(tmp_path / "far.ply", points + offset)
    (chunk,) = open_cloud(tmp_path / "far.ply").chunks()
    np.testing.assert_array_equal(chunk.points, points + offset)
    np.testing.assert_allclose(chunk.points - offset, points, atol=1e-9)
    assert chunk.points.dtype == np.float64


@pytest.mark.slow
def test_positions_of_only_some_scans_are_not_used(files, tmp_path):
    from tests.clouds.test_e57 import station, write

    pytest.importorskip("pye57")
    first, second = write(tmp_path / "a.e57", station(0), station(1)), write(tmp_path / "b.e57", station(2))
    survey = open_survey([first, second])
    views = survey.views
    assert len(views) == 3 and views.turning
    np.testing.assert_allclose(views.poses[:, :3, 3], [station(seed)[2] for seed in range(3)])
    cloud = read_survey([first, second])
    np.testing.assert_allclose(cloud.views.poses, views.poses, atol=1e-12)
    np.testing.assert_allclose(cloud.views.field_of_view, views.field_of_view)
    with pytest.warns(InputWarning, match="a.ply: does not say where the scanner stood"):
        assert read_survey([first, files / "a.ply"]).views is None
    with pytest.warns(InputWarning, match="a.ply: does not say where the scanner stood"):
        assert open_survey([first, files / "a.ply"]).views is None


def test_every_format_can_be_of_a_survey(files):
    cloud = read_survey([files / name for name in WRITERS])
    assert len(list(cloud.by_file())) == len(WRITERS)
