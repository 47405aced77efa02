import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from gmmjax.errors import InputError, InputWarning
from gmmjax.surveys import Intrinsics, read_depth_frame, write_depth_image
from tests.surveys.seen_room import CAMERA, around, frame

SMALL = Intrinsics.of_field_of_view((60.0, 45.0), 8, 6)
MILLIMETRES = np.random.default_rng(0).integers(300, 4000, (6, 8)).astype(np.uint16)


def png(image, **text):
    info = PngInfo()
    for key, value in text.items():
        info.add_text(key, value)
    content = io.BytesIO()
    Image.fromarray(image).save(content, "PNG", pnginfo=info)
    return content.getvalue()


@pytest.fixture
def saved(tmp_path):
    """Writes bytes, or an array as .npy, under a name."""

    def save(name, content):
        path = tmp_path / name
        path.write_bytes(content) if isinstance(content, bytes) else np.save(path, content)
        return path

    return save


def test_a_frame_comes_back_within_half_a_unit(tmp_path):
    seen = frame(around()[0], 0.0, noise=0.01)
    write_depth_image(tmp_path / "depth.png", seen)
    again = read_depth_frame(tmp_path / "depth.png", CAMERA, time=7.0)
    assert again.time == 7.0
    np.testing.assert_allclose(again.depth_image(), seen.depth_image(), atol=0.000501)
    off = again.image() - seen.image()
    assert np.nanmax(np.abs(off)) < 0.001 and (np.isnan(off) == np.isnan(seen.image())).all()


@given(st.floats(1e-4, 0.01), st.integers(0, 1000))
def test_the_unit_is_in_the_file(tmp_path_factory, unit, seed):
    path = tmp_path_factory.mktemp("depth") / "depth.png"
    depth = np.random.default_rng(seed).uniform(0.1, 6.0, (6, 8))
    depth[0, :3] = np.nan, np.inf, -1
    write_depth_image(path, depth, unit=unit)
    found = read_depth_frame(path, SMALL).depth_image()
    assert np.isnan(found[0, :3]).all()
    np.testing.assert_allclose(found.ravel()[3:], depth.ravel()[3:], atol=0.501 * unit)


@pytest.mark.parametrize("text", ["0.001", "0.001 m", " 1e-3 metres "])
def test_a_unit_that_another_writer_put_there(saved, text):
    found = read_depth_frame(saved("depth.PNG", png(MILLIMETRES, depth_unit=text)), SMALL)
    np.testing.assert_allclose(found.depth_image(), MILLIMETRES / 1000)


def test_what_is_told_goes_before_what_the_file_says(saved):
    path = saved("depth.png", png(MILLIMETRES, depth_unit="0.001"))
    np.testing.assert_allclose(read_depth_frame(path, SMALL, unit=0.0002).depth_image(), MILLIMETRES / 5000)


@pytest.mark.parametrize("content", [png(MILLIMETRES), MILLIMETRES.astype(np.int32), png(MILLIMETRES, Unit="mm")])
def test_a_unit_is_not_guessed(saved, content):
    path = saved("depth.png" if isinstance(content, bytes) else "depth.npy", content)
    with pytest.raises(InputError, match=r"what unit .*--depth-unit 0\.001 for millimetres"):
        read_depth_frame(path, SMALL)
    np.testing.assert_allclose(read_depth_frame(path, SMALL, unit=0.001).depth_image(), MILLIMETRES / 1000)


def test_floating_point_numbers_are_metres_unless_told(saved):
    metres = np.where(MILLIMETRES > 3500, np.nan, MILLIMETRES / 1000).astype(np.float32)
    path = saved("depth.npy", metres)
    np.testing.assert_allclose(read_depth_frame(path, SMALL).depth_image(), metres)
    np.testing.assert_allclose(read_depth_frame(path, SMALL, unit=0.5).depth_image(), metres / 2)


def test_metres_that_no_camera_sees(saved):
    with pytest.warns(InputWarning, match="if the numbers are millimetres, give --depth-unit 0.001"):
        read_depth_frame(saved("depth.npy", MILLIMETRES.astype(float)), SMALL)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.png", png(MILLIMETRES.astype(np.uint8)), "8-bit grey"),
        ("a.png", png(np.zeros((6, 8, 3), np.uint8)), "8-bit colours"),
        ("a.png", png(np.zeros((6, 8), bool)), "1-bit grey"),
        ("a.png", png(MILLIMETRES, depth_unit="a foot"), "no number of metres"),
        ("a.png", png(MILLIMETRES, depth_unit="-0.001"), "no number of metres"),
        ("a.png", png(MILLIMETRES, depth_unit="nan"), "no number of metres"),
        ("a.png", png(0 * MILLIMETRES, depth_unit="0.001"), "no pixel has a return"),
        ("a.png", png(MILLIMETRES.T, depth_unit="0.001"), "is 6 x 8 pixels, the intrinsics are of 8 x 6"),
        ("a.png", png(MILLIMETRES)[:-40], "damaged"),
        ("a.png", b"no image", "is no PNG image"),
        ("a.png", b"", "is empty"),
        ("a.npy", np.ones((6, 9)), "is 9 x 6 pixels, the intrinsics are of 8 x 6"),
        ("a.npy", np.ones((6, 8, 3)), r"\[height, width\]"),
        ("a.npy", np.ones((6, 8), complex), r"\[height, width\]"),
        ("a.npy", np.full((6, 8), np.nan), "no pixel has a return"),
        ("a.npy", b"no array", "no NumPy file"),
        ("a.jpg", b"no matter", "ends with .png or .npy"),
    ],
)
def test_what_is_no_depth_image(saved, name, content, message):
    path = saved(name, content)
    with pytest.raises(InputError, match=message) as caught:
        read_depth_frame(path, SMALL)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("position", range(8, 120, 7))
def test_cut_or_turned_bytes_are_an_input_error_or_the_image(saved, position):
    content = png(MILLIMETRES, depth_unit="0.001")
    turned = content[:position] + bytes([content[position] ^ 0x41]) + content[position + 1 :]
    for damaged in (content[:position], turned):
        try:
            read_depth_frame(saved("depth.png", damaged), SMALL)
        except InputError:
            continue


@pytest.mark.parametrize(
    ("name", "depth", "message"),
    [
        ("a.npy", np.ones((6, 8)), "written as .png"),
        ("a.png", np.full((6, 8), 66.0), "beyond 65535 times the unit"),
        ("a.png", np.ones(8), r"\[height, width\]"),
        ("a.png", np.ones((6, 8)), "unit=0.0"),
    ],
)
def test_what_is_not_written(tmp_path, name, depth, message):
    with pytest.raises(InputError, match=message):
        write_depth_image(tmp_path / name, depth, unit=0.0 if message == "unit=0.0" else 0.001)
    assert not list(tmp_path.iterdir())
