import dataclasses
import struct

import laspy
import numpy as np
import pytest

from gmmjax.clouds import LasSource, read_cloud, write_las
from gmmjax.errors import InputError
from tests.clouds.las_files import (
    GEOTIFF,
    SIZES,
    VERSIONS_AND_FORMATS,
    WKT,
    evlr,
    extra_descriptor,
    las_bytes,
    parsed,
    vlr,
)

NAMES = {"label": "index of the change", "probability": "of a change"}
CRS = (vlr(b"LASF_Projection", 34735, GEOTIFF), vlr(b"of somebody", 7, b"\xff\x00anything"))
ODD = "größe <ä>".encode()
EXTRA = extra_descriptor(b"amplitude", 9) + extra_descriptor(ODD, 13) + extra_descriptor(b"label", 6)
EXTRA_SIZE = 4 + 2 * 2 + 4


def values_of(count):
    return {
        "label": np.arange(-1, count - 1, dtype=np.int32),
        "probability": np.linspace(0, 1, count, dtype=np.float32),
    }


def rewritten(path, out, change=lambda cloud: cloud):
    """The file with the dimensions of `values_of`, for a changed cloud."""
    cloud = read_cloud(path)
    source = LasSource.of(cloud.file)
    out = out / f"out{source.ending}"
    cloud = change(cloud)
    write_las(out, source, cloud, values_of(len(cloud)), NAMES)
    return out, cloud


@pytest.mark.parametrize(("minor", "point_format"), [own for own in VERSIONS_AND_FORMATS if own[0]])
def test_every_version_and_point_format_keeps_points_and_records(write_file, tmp_path, minor, point_format):
    extended = (evlr(b"own", 3, b"anything" * 9),) if minor >= 4 else ()
    data = las_bytes(minor, point_format, extra=EXTRA, extra_size=EXTRA_SIZE, vlrs=CRS, evlrs=extended)
    out, _ = rewritten(write_file("a.las", data), tmp_path)
    old, new = parsed(data), parsed(out.read_bytes())
    np.testing.assert_array_equal(new["rows"][:, : old["rows"].shape[1]], old["rows"])
    assert (new["minor"], new["format"]) == (minor, point_format)
    assert (new["records"][:2], new["extended"]) == (old["records"][:2], old["extended"])
    # All of the header but where things are and how many, from the identification to the date, and the bounds.
    for start, end in ((0, 94), (131, 227)):
        assert new["head"][start:end] == old["head"][start:end]
    for name in (b"amplitude", ODD):
        np.testing.assert_array_equal(new["extra"][name], old["extra"][name])
    np.testing.assert_array_equal(new["extra"][b"input_label"], old["extra"][b"label"])
    las = laspy.read(out)
    np.testing.assert_array_equal(las.label, values_of(30)["label"])
    np.testing.assert_array_equal(las.probability, values_of(30)["probability"])


def test_descriptions_of_extra_bytes_stay(write_file, tmp_path):
    """The value that stands for no data and the scale, and no range: that of laspy is of single points."""
    descriptor = bytearray(extra_descriptor(b"amplitude", 3, 0b1111, b"of the echo"))
    struct.pack_into("<Q", descriptor, 40, 65535)
    struct.pack_into("<d", descriptor, 112, 0.01)
    data = las_bytes(4, 6, extra=bytes(descriptor), extra_size=2)
    out, _ = rewritten(write_file("a.las", data), tmp_path)
    (content,) = (content for user, number, content in parsed(out.read_bytes())["records"] if number == 4)
    assert content[3] == 0b1001
    for start, end in ((0, 3), (4, 64), (112, 192)):
        assert content[start:end] == descriptor[start:end]
    assert content[192 + 3] == content[2 * 192 + 3] == 0


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (las_bytes(0, 1), "is LAS 1.0, which is not written"),
        (las_bytes(3, 4, evlrs=(evlr(b"LASF_Spec", 65535, b"waveforms"),)), "holds waveforms"),
        (las_bytes(2, 1, extra_size=300), "has 300 bytes a point without a description"),
        (las_bytes(2, 6), "laspy cannot write it again"),
        (las_bytes(4, 6, evlrs=(evlr(b"a", 1, b"b" * 100),))[:-1], "its extended record 0 of 1 runs beyond byte"),
    ],
)
def test_files_that_are_read_and_not_written_again(write_file, tmp_path, data, message):
    path = write_file("a.las", data)
    assert len(read_cloud(path)) == 30
    with pytest.raises(InputError, match=rf"a\.las: {message}"):
        rewritten(path, tmp_path)
    assert not list(tmp_path.iterdir())


def laz(tmp_path, point_format, version="1.4"):
    """A compressed file with all dimensions in use, and one extra one."""
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.add_extra_dim(laspy.ExtraBytesParams("amplitude", np.float32, "of the echo"))
    header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", WKT.encode()))
    las = laspy.LasData(header)
    generator = np.random.default_rng(0)
    las.x, las.y, las.z = generator.normal(size=(3, 200)).round(2)
    for name in las.point_format.dimension_names:
        if name not in ("X", "Y", "Z"):
            las[name] = generator.integers(0, 2, 200, dtype=np.uint8)
    las.return_number[:] = 1
    path = tmp_path / "in.laz"
    las.write(path, laz_backend=laspy.LazBackend.Laszip)
    return path, las


@pytest.mark.parametrize("point_format", range(11))
def test_compressed_files_are_read_back_by_laszip(tmp_path, point_format):
    pytest.importorskip("laszip")
    path, las = laz(tmp_path, point_format)
    out, _ = rewritten(path, tmp_path)
    # lazrs does not write waveform packets as LASzip does.
    assert out.suffix == (".las" if point_format in (4, 5, 9, 10) else ".laz")
    for backend in (laspy.LazBackend.Laszip, laspy.LazBackend.Lazrs):
        new = laspy.read(out, laz_backend=backend)
        for name in las.point_format.dimension_names:
            np.testing.assert_array_equal(new[name], las[name], name)
        np.testing.assert_array_equal(new.label, values_of(200)["label"])
        assert new.header.vlrs.get_by_id("LASF_Projection", (2112,))[0].string == WKT
        assert new.header.are_points_compressed == (out.suffix == ".laz")


def moved(by):
    return lambda cloud: dataclasses.replace(cloud, points=cloud.points + by)


def test_moved_points_are_rounded_to_the_scale_of_the_file(write_file, tmp_path):
    data = las_bytes(2, 3, vlrs=CRS)
    out, cloud = rewritten(write_file("a.las", data), tmp_path, moved(np.array([0.12345, -3.0, 0.0])))
    old, new = parsed(data), parsed(out.read_bytes())
    np.testing.assert_allclose(new["points"], cloud.points, rtol=0, atol=0.000501)
    np.testing.assert_array_equal(new["rows"][:, 12:34], old["rows"][:, 12:34])
    assert new["head"][131:179] == old["head"][131:179]
    bounds = struct.unpack_from("<6d", new["head"], 179)
    np.testing.assert_allclose(bounds[1::2], new["points"].min(axis=0))
    np.testing.assert_allclose(bounds[::2], new["points"].max(axis=0))


@pytest.mark.parametrize("by", [5e6, 1e12])
def test_the_offset_gives_way_where_points_move_out_of_range(write_file, tmp_path, by):
    out, cloud = rewritten(write_file("a.las", las_bytes(2, 1)), tmp_path, moved(np.array([by, 0.0, 0.0])))
    new = parsed(out.read_bytes())
    np.testing.assert_allclose(new["points"], cloud.points, rtol=1e-15, atol=0.000501)
    assert struct.unpack_from("<d", new["head"], 131)[0] == 0.001


def test_points_that_the_scale_does_not_reach_are_refused(write_file, tmp_path):
    spread = np.linspace(0, 1e9, 30)[:, None] * np.array([1.0, 0.0, 0.0])
    with pytest.raises(InputError, match=r"a\.las: its scale .0\.001, .* is too fine for its points .*"):
        rewritten(write_file("a.las", las_bytes(2, 1)), tmp_path, moved(spread))
    assert not list(tmp_path.iterdir())


def test_points_that_were_left_out_are_counted_out(write_file, tmp_path):
    def every_other(cloud):
        return dataclasses.replace(
            cloud, points=cloud.points[::2], rows=cloud.rows[::2], fields={}, colors=None, rows_dropped=15
        )

    data = las_bytes(4, 6)
    out, _ = rewritten(write_file("a.las", data), tmp_path, every_other)
    new = parsed(out.read_bytes())
    np.testing.assert_array_equal(new["rows"][:, :30], parsed(data)["rows"][::2])
    assert struct.unpack_from("<2Q", new["head"], 247) == (15, 15)
    assert len(laspy.read(out).points) == 15


def test_unmoved_points_keep_their_integers_bit_for_bit(write_file, tmp_path):
    """Beside others that moved; so far away that float64 does not resolve millimetres."""

    def some_moved(cloud):
        return dataclasses.replace(cloud, points=cloud.points + (np.arange(30) % 2)[:, None])

    data = las_bytes(2, 1, offset=(1e14, 1e14, 1e14))
    out, _ = rewritten(write_file("a.las", data), tmp_path, some_moved)
    np.testing.assert_array_equal(parsed(out.read_bytes())["rows"][::2, :28], parsed(data)["rows"][::2])


def test_huge_scales_are_no_error(write_file, tmp_path):
    path = write_file("a.las", las_bytes(2, 1, scale=1e300))
    out, cloud = rewritten(path, tmp_path, moved(np.array([1e307, 0.0, 0.0])))
    np.testing.assert_allclose(read_cloud(out).points, cloud.points, rtol=1e-6, atol=1e300)


def test_bytes_without_a_description_stay_and_are_described(write_file, tmp_path):
    data = las_bytes(2, 1, extra_size=200)
    out, _ = rewritten(write_file("a.las", data), tmp_path)
    new = parsed(out.read_bytes())
    np.testing.assert_array_equal(new["rows"][:, : SIZES[1] + 200], parsed(data)["rows"])
    np.testing.assert_array_equal(new["extra"][b"label"], values_of(30)["label"])


def test_a_file_that_was_changed_is_not_taken_for_the_one_that_was_read(write_file, tmp_path):
    path = write_file("a.las", las_bytes(2, 1))
    cloud = read_cloud(path)
    path.write_bytes(las_bytes(2, 1, count=29))
    with pytest.raises(InputError, match="was changed since it was read"):
        LasSource.of(cloud.file)
    path.unlink()
    with pytest.raises(InputError, match="cannot be opened"):
        LasSource.of(cloud.file)


def test_records_of_the_storage_are_left_out(write_file, tmp_path):
    octree = (vlr(b"copc", 1, b"c" * 160), *CRS)
    data = las_bytes(4, 6, vlrs=octree, evlrs=(evlr(b"copc", 1000, b"h" * 32), evlr(b"own", 3, b"kept")))
    out, _ = rewritten(write_file("a.las", data), tmp_path)
    new = parsed(out.read_bytes())
    assert [user for user, *_ in new["records"]] == [b"LASF_Projection", b"of somebody", b"LASF_Spec"]
    assert new["extended"] == [(b"own", 3, b"kept")]
