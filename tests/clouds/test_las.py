import laspy
import numpy as np
import pytest

from gmmjax.clouds import read_cloud
from gmmjax.errors import InputError

OFFSET = np.array([500_000.0, 4_000_000.0, 100.0])


@pytest.fixture(scope="module", params=["las", "laz"])
def survey(request, tmp_path_factory):
    """A file with millimetres, 16-bit colours, intensity and classification, and what it holds."""
    generator = np.random.default_rng(0)
    points = OFFSET + generator.integers(-20_000, 20_000, (400, 3)) / 1000
    colors = generator.integers(0, 256, (400, 3), dtype=np.uint8)
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.offsets, header.scales = OFFSET, np.full(3, 0.001)
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    las.red, las.green, las.blue = colors.T.astype(np.uint16) * 257
    las.intensity = np.arange(400)
    las.classification = np.arange(400) % 20
    path = tmp_path_factory.mktemp("las") / f"survey.{request.param}"
    las.write(str(path))
    return path, points, colors


def test_scale_offset_colors_and_fields(survey):
    path, points, colors = survey
    cloud = read_cloud(path)
    np.testing.assert_allclose(cloud.points, points, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(cloud.colors, colors)
    np.testing.assert_array_equal(cloud.fields["intensity"], np.arange(400))
    np.testing.assert_array_equal(cloud.fields["classification"], np.arange(400) % 20)


def test_without_colors_and_points(tmp_path):
    las = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    path = tmp_path / "survey.las"
    las.write(str(path))
    with pytest.raises(InputError, match="has 0 points"):
        read_cloud(path)
    las.x, las.y, las.z = [1.0], [2.0], [3.0]
    las.write(str(path))
    cloud = read_cloud(path)
    assert cloud.points.tolist() == [[1, 2, 3]]
    assert cloud.colors is None


def test_cut_anywhere_is_an_input_error(survey, write_file):
    whole = survey[0].read_bytes()
    for cut in range(1, len(whole) - 1, 211):
        path = write_file(survey[0].name, whole[:cut])
        with pytest.raises(InputError) as caught:
            read_cloud(path)
        assert str(path) in str(caught.value)


@pytest.mark.parametrize(("byte", "what"), [(103, "records"), (110, "copy")])
def test_damaged_counts_are_found_before_room_is_made_for_them(survey, write_file, byte, what):
    # Byte 103 is the highest of the number of records, byte 110 of the number of points.
    damaged = bytearray(survey[0].read_bytes())
    damaged[byte] = 200
    with pytest.raises(InputError, match=what):
        read_cloud(write_file(survey[0].name, bytes(damaged)))


def test_other_files_under_the_name(write_file):
    with pytest.raises(InputError, match="no LAS or LAZ file"):
        read_cloud(write_file("a.las", b"ply\n" * 100))
