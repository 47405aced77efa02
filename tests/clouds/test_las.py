import contextlib
import struct
import subprocess
import sys

import laspy
import numpy as np
import pytest

from gmmjax.clouds import open_cloud, read_cloud
from gmmjax.clouds.decoder_process import PROGRAM, DecoderProcess
from gmmjax.errors import InputError, InputWarning
from tests.clouds.las_files import GEOTIFF, VERSIONS_AND_FORMATS, WKT, evlr, extra_descriptor, las_bytes, parsed, vlr

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


def test_other_files_under_the_name(write_file):
    with pytest.raises(InputError, match="no LAS or LAZ file"):
        read_cloud(write_file("a.las", b"ply\n" * 100))


def changed(path, place, kind, value):
    """The file with another number at a place of its header."""
    data = bytearray(path.read_bytes())
    struct.pack_into(kind, data, place, value)
    return bytes(data)


@pytest.mark.parametrize(
    ("place", "kind", "value", "message"),
    [
        (24, "<B", 2, "has version 2.2, known are 1.0 to 1.5"),
        (25, "<B", 9, "has version 1.9"),
        (94, "<H", 10, "has a header of 10|a header of 10 and points from"),
        (96, "<I", 10**9, "points from byte 1000000000 on, which cannot be"),
        # Highest bytes of the number of records and of points.
        (103, "<B", 200, "record . of 33554.* runs beyond byte"),
        (110, "<B", 200, "copy"),
        (104, "<B", 11, "laspy cannot read its header .PointFormatNotSupported: (11|None)"),
        (105, "<H", 10, "Incoherent point size"),
        (131, "<d", np.nan, r"has scales \[nan"),
        (131, "<d", 0.0, r"has scales \[0.0"),
        (155, "<d", np.inf, "and offsets .inf"),
    ],
)
def test_numbers_that_the_file_contradicts(survey, write_file, place, kind, value, message):
    if survey[0].suffix == ".laz" and place == 104:
        value |= 128
    with pytest.raises(InputError, match=message):
        read_cloud(write_file(survey[0].name, changed(survey[0], place, kind, value)))


@pytest.fixture(scope="module")
def laz(tmp_path_factory):
    las = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    las.x, las.y, las.z = np.random.default_rng(0).normal(size=(3, 100)).round(2)
    path = tmp_path_factory.mktemp("laz") / "a.laz"
    las.write(str(path))
    return path


@pytest.mark.parametrize(
    ("part", "place", "kind", "value", "message"),
    [
        ("vlr", 2, "<16s", b"someone else", "is compressed and has no record of LASzip"),
        ("vlr", 20, "<H", 60_000, "record 0 of 1 runs beyond byte"),
        ("laszip", 12, "<I", 7, "its chunks hold 7 points, 100 are declared"),
        *[("laszip", place, "<H", value, "lazrs cannot read it") for place, value in ((0, 1), (32, 9), (36, 21))],
        *[("points", 0, "<q", value, "lazrs cannot read it") for value in (10**9, 3)],
        ("table", 4, "<I", 2**31, "cannot read it|crashed on it"),
        ("table", 8, "<I", 2**32 - 1, "cannot read it|crashed on it"),
    ],
)
def test_compression_that_is_damaged(laz, write_file, part, place, kind, value, message):
    data = laz.read_bytes()
    header, points = struct.unpack_from("<HI", data, 94)
    table = struct.unpack_from("<q", data, points)[0]
    start = {"vlr": header, "laszip": header + 54, "points": points, "table": table}[part]
    path = write_file("a.laz", changed(laz, start + place, kind, value))
    with pytest.raises(InputError, match=message) as caught:
        read_cloud(path)
    assert str(path) in str(caught.value)


@pytest.fixture
def decompressor(monkeypatch, tmp_path):
    """Puts a lazrs in front whose import runs the given line."""

    def install(line: str) -> None:
        (tmp_path / "lazrs.py").write_text(line)
        monkeypatch.syspath_prepend(tmp_path)

    return install


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("import os; os.abort()", r"a\.laz: lazrs crashed on it \(signal 6\); the file is damaged"),
        ("import os; os._exit(3)", r"a\.laz: lazrs crashed on it \(exit status 3\); the file is damaged"),
        ("import time; time.sleep(100)", r"a\.laz: lazrs did not finish within 2 s; the file is damaged"),
        ("raise MemoryError", r"a\.laz: lazrs needs more memory for it"),
        ("raise ImportError('no lazrs')", r"a\.laz: LAZ files need lazrs \(no lazrs\): pip install lazrs"),
        ("raise ValueError('two\\nlines')", r"a\.laz: lazrs cannot read it \(two lines\); the file is damaged"),
        ("print('something'); raise ValueError('no')", r"a\.laz: lazrs cannot read it \(no\)"),
    ],
)
def test_how_the_decompressor_may_end(laz, decompressor, monkeypatch, line, message):
    decompressor(line)
    monkeypatch.setattr("gmmjax.clouds.decoder_process.START", 2.0)
    with pytest.raises(InputError, match=message):
        read_cloud(laz)


def test_memory_of_the_decompressor_is_bounded(laz, decompressor):
    decompressor("LazVlr = bytes\ndef read_chunk_table(*_): return [(100, 10**13)] if bytearray(1 << 50) else 0")
    with pytest.raises(InputError, match="lazrs needs more memory for it than a file of its size takes"):
        read_cloud(laz)


def test_a_process_starts_again_after_a_crash(laz, monkeypatch):
    kept = DecoderProcess()
    monkeypatch.setattr("gmmjax.clouds.las.DecoderProcess", lambda: contextlib.nullcontext(kept))
    with kept:
        first = read_cloud(laz)
        with monkeypatch.context() as patched:
            patched.setattr("gmmjax.clouds.las.SLOWEST", 1e12)
            patched.setattr("gmmjax.clouds.decoder_process.START", 0.0)
            with pytest.raises(InputError, match="did not finish within 0 s"):
                read_cloud(laz)
        np.testing.assert_array_equal(read_cloud(laz).points, first.points)


def test_the_process_starts_without_the_package(tmp_path):
    program = "import runpy, sys; runpy.run_path(sys.argv[1], run_name='other'); print(*sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", program, str(PROGRAM)], capture_output=True, text=True, check=True)
    assert not {"gmmjax", "jax", "numpy", "lazrs", "open3d"} & set(loaded.stdout.split())


def test_what_is_done_between_two_blocks_does_not_count_as_decoding(laz, monkeypatch):
    elapsed = [0.0]
    monkeypatch.setattr("gmmjax.clouds.decoder_process.time.monotonic", lambda: elapsed[0])
    found = 0
    for chunk in open_cloud(laz).chunks():
        found += len(chunk.points)
        elapsed[0] += 1e9
    assert found == len(read_cloud(laz))


def test_reading_that_is_given_up_ends_the_process(laz, monkeypatch):
    started = []

    class Noted(subprocess.Popen):
        def __init__(self, *arguments, **named):
            super().__init__(*arguments, **named)
            started.append(self)

    monkeypatch.setattr("gmmjax.clouds.decoder_process.subprocess.Popen", Noted)
    chunks = open_cloud(laz).chunks(10)
    next(chunks)
    assert [process.poll() for process in started] == [None]
    chunks.close()
    assert [process.poll() is None for process in started] == [False]


def compressed_by(tmp_path, version):
    """Points whose items are said to be of a version: those of 3 and 4 differ in nothing that such points have."""
    las = laspy.LasData(laspy.LasHeader(point_format=7, version="1.4"))
    las.x = las.y = las.z = las.red = np.arange(1000)
    path = tmp_path / "survey.laz"
    las.write(path)
    data = bytearray(path.read_bytes())
    items = data.index(b"laszip encoded") + 52 + 34
    for item in (items, items + 6):
        assert data[item + 4] == 3
        data[item + 4] = version
    path.write_bytes(data)
    return path


def test_newer_items_are_read_by_laszip(tmp_path):
    np.testing.assert_array_equal(read_cloud(compressed_by(tmp_path, 4)).points[:, 0], np.arange(1000))
    path = compressed_by(tmp_path, 9)
    with pytest.raises(InputError, match=r"survey\.laz: lazrs cannot read it"):
        read_cloud(path)


def test_newer_items_without_laszip(tmp_path, monkeypatch):
    (tmp_path / "without").mkdir()
    (tmp_path / "without" / "laszip.py").write_text("raise ModuleNotFoundError('none', name='laszip')")
    monkeypatch.syspath_prepend(tmp_path / "without")
    with pytest.raises(InputError, match=r"newer LASzip than lazrs reads: pip install laszip"):
        read_cloud(compressed_by(tmp_path, 4))


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_version_1_5(tmp_path, ending):
    las = laspy.LasData(laspy.LasHeader(point_format=7, version="1.4"))
    las.x = las.y = las.z = las.red = np.arange(100)
    path = tmp_path / f"survey.{ending}"
    las.write(path)
    data = bytearray(path.read_bytes())
    # The header of 1.5 is that of 1.4 and 18 bytes: the earliest, the latest and the offset of the times.
    header_size, start = struct.unpack_from("<HI", data, 94)
    struct.pack_into("<BB68xHI", data, 24, 1, 5, header_size + 18, start + 18)
    if ending == "laz":
        table = struct.unpack_from("<q", data, start)[0]
        struct.pack_into("<q", data, start, table + 18)
    path.write_bytes(data[:header_size] + bytes(18) + data[header_size:])
    np.testing.assert_array_equal(read_cloud(path).points[:, 0], np.arange(100))


def test_heights_in_another_unit_are_warned_of(write_file):
    keys = struct.pack("<20H", 1, 1, 0, 4, 1024, 0, 1, 1, 3072, 0, 1, 26910, 3076, 0, 1, 9001, 4099, 0, 1, 9003)
    path = write_file("a.las", las_bytes(2, 0, vlrs=(vlr(b"LASF_Projection", 34735, keys),)))
    with pytest.warns(InputWarning, match=r"a\.las: states heights in ftUS, and x and y in another unit"):
        assert read_cloud(path).unit is None


def test_the_reference_system_is_read_from_keys_and_text(write_file):
    keys = vlr(b"LASF_Projection", 34735, GEOTIFF)
    text = vlr(b"LASF_Projection", 2112, WKT.encode() + b"\0")
    behind = evlr(b"LASF_Projection", 2112, WKT.encode())
    for data in (las_bytes(2, 1, vlrs=(keys,)), las_bytes(4, 6, vlrs=(text,)), las_bytes(4, 6, evlrs=(behind,))):
        cloud = read_cloud(write_file("a.las", data))
        assert (cloud.unit, cloud.crs) == ("m", "EPSG:25832")
    assert read_cloud(write_file("a.las", las_bytes(2, 1))).unit is None


@pytest.mark.parametrize(("minor", "point_format"), VERSIONS_AND_FORMATS)
def test_every_version_and_point_format(write_file, minor, point_format):
    data = las_bytes(minor, point_format, scale=1e-7, extra=extra_descriptor(b"amplitude", 9), extra_size=4)
    expected, cloud = parsed(data), read_cloud(write_file("a.las", data))
    np.testing.assert_array_equal(cloud.points, expected["points"])
    np.testing.assert_array_equal(cloud.fields["intensity"], expected["rows"][:, 12:14].copy().view("<u2")[:, 0])
    classes = expected["rows"][:, 16] if point_format >= 6 else expected["rows"][:, 15] & 31
    np.testing.assert_array_equal(cloud.fields["classification"], classes)
    assert (cloud.colors is not None) == (point_format in (2, 3, 5, 7, 8, 10))


@pytest.mark.parametrize("extra", [extra_descriptor(b"gr\xf6\xdfe", 4), extra_descriptor(b"a", 99)])
def test_what_laspy_does_not_read(write_file, extra):
    path = write_file("a.las", las_bytes(4, 6, extra=extra, extra_size=2))
    with pytest.raises(InputError, match=rf"{path.name}: laspy cannot read its header \(.*: .*export it again"):
        read_cloud(path)
