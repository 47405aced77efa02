import struct
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.errors import InputError
from gmmjax.surveys import Frame
from gmmjax.surveys.point_cloud2 import PackedCloud, PointField, decode_cloud, decode_frame, encode_cloud

# The datatypes of sensor_msgs/PointField as the struct module writes them.
LETTERS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}
# Small whole numbers are exact in every type.
NUMBERS = st.integers(0, 100)
AXES = tuple(PointField(axis, 4 * index, 7, 1) for index, axis in enumerate("xyz"))


@st.composite
def packed_clouds(draw):
    """A message of any layout: fields in any order, of any type, with gaps, in rows with padding."""
    names = draw(st.permutations(["x", "y", "z", *sorted(draw(st.sets(st.sampled_from(["ring", "t", "_"]))))]))
    fields, offset = [], 0
    for name in names:
        offset += draw(st.integers(0, 5))
        count = 1 if name in "xyz" else draw(st.integers(0, 3))
        fields.append(PointField(name, offset, draw(st.sampled_from(sorted(LETTERS))), count))
        offset += struct.calcsize(LETTERS[fields[-1].datatype]) * max(count, 1)
    height, width = draw(st.integers(1, 4)), draw(st.integers(0, 5))
    point_step = offset + draw(st.integers(0, 7))
    row_step = width * point_step + draw(st.integers(0, 9))
    data = bytearray(draw(st.binary(min_size=height * row_step, max_size=height * row_step)))
    big_endian = draw(st.booleans())
    for field in fields:
        for start in point_starts(height, width, point_step, row_step):
            values = draw(st.lists(NUMBERS, min_size=max(field.count, 1), max_size=max(field.count, 1)))
            struct.pack_into(layout(field, big_endian), data, start + field.offset, *values)
    if draw(st.booleans()):
        # Some writers leave the padding of the last row out.
        data = data[: height * row_step - (row_step - width * point_step)]
    # No `PackedCloud`: the check of its types draws random numbers, which Hypothesis forbids here.
    return SimpleNamespace(
        height=height,
        width=width,
        fields=fields,
        is_bigendian=big_endian,
        point_step=point_step,
        row_step=row_step,
        data=np.frombuffer(bytes(data), np.uint8),
        is_dense=draw(st.booleans()),
    )


def layout(field, big_endian):
    return (">" if big_endian else "<") + str(max(field.count, 1)) + LETTERS[field.datatype]


def point_starts(height, width, point_step, row_step):
    return [row * row_step + column * point_step for row in range(height) for column in range(width)]


def numbers_by_name(packed):
    """What each field holds, point by point: the plain way to read a message."""
    starts = point_starts(packed.height, packed.width, packed.point_step, packed.row_step)
    return {
        field.name: [
            struct.unpack_from(layout(field, packed.is_bigendian), packed.data.tobytes(), start + field.offset)
            for start in starts
        ]
        for field in packed.fields
        if field.name != "_"
    }


@given(packed_clouds())
def test_any_layout_is_read_as_point_by_point(packed):
    cloud = decode_cloud(packed, "bag")
    expected = numbers_by_name(packed)
    for axis, name in enumerate("xyz"):
        assert cloud.points[:, axis].tolist() == [values[0] for values in expected.pop(name)]
    columns = {}
    for name, values in expected.items():
        count = next(max(field.count, 1) for field in packed.fields if field.name == name)
        names = [name] if count == 1 else [f"{name}_{index}" for index in range(count)]
        columns |= {each: [row[index] for row in values] for index, each in enumerate(names)}
    assert {name: values.tolist() for name, values in cloud.fields.items()} == columns


@pytest.mark.parametrize("shape", [(1, 7), (5, 3), (2, 1)])
def test_what_is_encoded_is_decoded(shape):
    random = np.random.default_rng(0)
    image = random.normal(size=(*shape, 3))
    image[random.random(shape) < 0.3] = np.nan
    frame = Frame.of_image(image, 5.0, "camera")
    packed = encode_cloud(frame)
    cloud = decode_cloud(packed, "bag")
    np.testing.assert_array_equal(cloud.points, frame.cloud.points.astype(np.float32))
    np.testing.assert_array_equal(cloud.rows, frame.cloud.rows)
    assert packed.is_dense is not np.isnan(image).any()


def message(stamp=(12, 500_000_000), **changes):
    """A message of 2 x 2 points, of which one is not finite."""
    points = np.array([[[0, 0, 1], [np.nan, 0, 0]], [[0, 1, 1], [1, 1, 1]]])
    packed = vars(encode_cloud(Frame.of_image(points, 0.0)))
    header = SimpleNamespace(stamp=SimpleNamespace(sec=stamp[0], nanosec=stamp[1]), frame_id="camera")
    return SimpleNamespace(header=header, **(packed | changes))


def test_a_message_above_height_one_is_an_ordered_frame():
    frame = decode_frame(message(), "bag", 99.0)
    assert (frame.time, frame.name, frame.width, frame.height) == (12.5, "camera", 2, 2)
    assert frame.cloud.rows.tolist() == [0, 2, 3]
    assert frame.cloud.rows_dropped == 1


def test_a_message_of_height_one_is_in_no_order():
    frame = decode_frame(message(height=1, width=4, row_step=0), "bag", 99.0)
    assert frame.width is None
    assert len(frame.cloud) == 3


def test_the_time_of_the_record_stands_in_for_a_stamp_of_zero():
    assert decode_frame(message(stamp=(0, 0)), "bag", 99.0).time == 99.0


@pytest.mark.parametrize("datatype", [6, 7])
@pytest.mark.parametrize("big_endian", [False, True])
def test_packed_colours_are_colours(datatype, big_endian):
    order = ">" if big_endian else "<"
    data = struct.pack(order + "3fI", 1, 2, 3, 0x00FF8001)
    fields = (
        *(PointField(axis, 4 * index, 7, 1) for index, axis in enumerate("xyz")),
        PointField("rgb", 12, datatype, 1),
    )
    packed = PackedCloud(1, 1, fields, big_endian, 16, 16, np.frombuffer(data, np.uint8), True)
    cloud = decode_cloud(packed, "bag")
    assert cloud.colors.tolist() == [[255, 128, 1]]
    assert not cloud.fields


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fields": AXES[:2]}, "has no z, only: x, y"),
        ({"fields": (*AXES[:2], PointField("z", 10, 7, 1))}, "'z' ends after byte 12"),
        ({"fields": (*AXES[:2], PointField("z", 8, 9, 1))}, "unknown datatype 9"),
        ({"fields": (*AXES, AXES[0])}, "x more than once"),
        ({"width": 3}, "cut off"),
        ({"data": np.zeros(40, np.uint8)}, "40 bytes are there"),
        ({"row_step": 12}, "rows of 12"),
    ],
)
def test_a_layout_that_does_not_fit_is_an_input_error(changes, words):
    with pytest.raises(InputError, match=f"^run.bag: .*{words}"):
        decode_cloud(message(**changes), "run.bag")
