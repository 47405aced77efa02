import json

import numpy as np
import pytest

from gmmjax.errors import InputError, InputWarning
from gmmjax.surveys import Intrinsics, read_intrinsics, write_intrinsics

CAMERA = Intrinsics(186.41, 206.37, 111.5, 85.25, 224, 171)
MATRIX = [186.41, 0.0, 111.5, 0.0, 206.37, 85.25, 0.0, 0.0, 1.0]
COLUMNS = [186.41, 0, 0, 0, 206.37, 0, 111.5, 85.25, 1]
CALIBRATION = """image_width: 224
image_height: 171
camera_name: haz
camera_matrix:
  rows: 3
  cols: 3
  data: [186.41, 0.0, 111.5,
         0.0, 206.37, 85.25, 0.0, 0.0, 1.0]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.0, 0.0, 0.0, 0.0, 0.0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""
ROS1 = """header:
  seq: 12
height: 171
width: 224
distortion_model: "plumb_bob"
D: []
K: [186.41, 0.0, 111.5, 0.0, 206.37, 85.25, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
roi:
  x_offset: 0
  height: 0
  width: 0
---
"""
ROS2 = "height: 171\nwidth: 224\nd:\n- 0.0\n- 0.0\nk:\n" + "".join(f"- {x}\n" for x in MATRIX) + "r:\n- 1.0\n- 0.0\n"


def test_round_trip(tmp_path):
    write_intrinsics(tmp_path / "camera.json", CAMERA)
    assert read_intrinsics(tmp_path / "camera.json") == CAMERA


@pytest.mark.parametrize(
    "text",
    [
        json.dumps({"width": 224, "height": 171, "intrinsic_matrix": COLUMNS}),
        json.dumps({"intrinsic": {"width": 224, "height": 171, "intrinsic_matrix": COLUMNS}, "extrinsic": []}),
        json.dumps({"width": 224, "height": 171, "K": MATRIX}),
        CALIBRATION,
        ROS1,
        ROS2,
    ],
    ids=["Open3D", "Open3D parameters", "K", "calibration file", "ROS 1 message", "ROS 2 message"],
)
def test_what_others_write(tmp_path, text):
    (tmp_path / "camera").write_text(text)
    assert read_intrinsics(tmp_path / "camera") == CAMERA


def test_what_open3d_writes(open3d, tmp_path):
    size, numbers = (CAMERA.width, CAMERA.height), (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    camera = open3d.camera.PinholeCameraIntrinsic(*size, *numbers)
    open3d.io.write_pinhole_camera_intrinsic(str(tmp_path / "camera.json"), camera)
    found = read_intrinsics(tmp_path / "camera.json")
    np.testing.assert_allclose(found.matrix(), CAMERA.matrix())


@pytest.mark.parametrize(
    "text", [CALIBRATION.replace("data: [0.0, 0.0", "data: [-0.21, 0.0"), ROS2.replace("d:\n- 0.0", "d:\n- -0.21")]
)
def test_distortion_is_said_not_to_be_applied(tmp_path, text):
    (tmp_path / "camera.yaml").write_text(text)
    with pytest.warns(InputWarning, match="distortion"):
        assert read_intrinsics(tmp_path / "camera.yaml") == CAMERA


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{}", "has no fx, fy, cx, cy, width, height"),
        ("[1, 2]", "has no fx"),
        ("no intrinsics", "has no fx"),
        ("[" * 100_000, "has no fx"),
        ('{"fx": 1, "fy": 1, "cx": 1, "cy": 1}', "has no width, height"),
        ('{"intrinsic": 3}', "has no fx"),
        ('{"width": 4, "height": 4, "intrinsic_matrix": [1, 2]}', "has no fx"),
        ('{"fx": "wide", "fy": 1, "cx": 1, "cy": 1, "width": 4, "height": 4}', "fx='wide' must be a number"),
        ('{"fx": null, "fy": 1, "cx": 1, "cy": 1, "width": 4, "height": 4}', "fx=None must be a number"),
        ('{"fx": 1, "fy": 1, "cx": 1, "cy": 1, "width": 4.5, "height": 4}', "whole number"),
        ('{"fx": 1, "fy": 1, "cx": 1, "cy": 1, "width": "4", "height": 4}', "whole number"),
        ('{"fx": 1, "fy": 1, "cx": 9, "cy": 1, "width": 4, "height": 4}', "outside of an image"),
        ('{"fx": NaN, "fy": 1, "cx": 1, "cy": 1, "width": 4, "height": 4}', "NaN is no number of JSON"),
        ('{"fx": 1' + 400 * "0" + ', "fy": 1, "cx": 1, "cy": 1, "width": 4, "height": 4}', "too large"),
        ("width: " + 5000 * "9" + "\nheight: 4\nK: [1, 0, 1, 0, 1, 1, 0, 0, 1]\n", "whole number"),
    ],
)
def test_what_are_no_intrinsics(tmp_path, text, message):
    (tmp_path / "camera.json").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_intrinsics(tmp_path / "camera.json")
    assert str(tmp_path) in str(caught.value)


def test_another_ending(tmp_path):
    with pytest.raises(InputError, match=r"written as \.json"):
        write_intrinsics(tmp_path / "camera.yaml", CAMERA)
