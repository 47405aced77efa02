import dataclasses
import io
import struct

import numpy as np
import pytest
from PIL import Image

from gmmjax.changes import Registration
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.pair import Pair
from gmmjax.reporting import ThumbnailSettings, write_thumbnails
from gmmjax.reporting.palette import KIND_COLORS, color_bytes
from tests.reporting.conftest import change, labelled

RANDOM = np.random.default_rng(3)
# A room of 8 m with a wall in front, as the first view sees it: from the side of negative y.
FLOOR = RANDOM.uniform([0, 0, 0], [8, 6, 0.02], (6000, 3))
FRONT = RANDOM.uniform([0, 0, 0], [8, 0.02, 3], (6000, 3))
ROOM = np.concatenate([FLOOR, FRONT])
OFFSET = np.array([5e6, 4e6, 1e3])


def drawn(folder, changes, before, after=None, colors=None, settings=ThumbnailSettings()):
    """The two thumbnails as arrays [height, width, RGBA]."""
    clouds = Pair(before, before if after is None else after)
    write_thumbnails(folder, clouds.map(lambda points: PointCloud.from_rows(points, colors=colors)), changes, settings)
    return tuple(np.asarray(Image.open(folder / name).convert("RGBA")) for name in ("before.png", "after.png"))


def unchanged(pair, points):
    return labelled(pair[2], np.full(len(points), -1), np.full(len(points), -1), ())


def with_change(pair, points, chosen, kind="disappeared"):
    """The chosen points of the before cloud are one change."""
    labels = np.where(np.isin(np.arange(len(points)), chosen), 0, -1)
    around = points[chosen].mean(axis=0) + np.random.default_rng(0).normal(0, 0.01, (20, 3))
    return labelled(pair[2], labels, np.full(len(points), -1), (change(kind, around),))


def pixels_of(image, color):
    return np.argwhere((image == [*color, 255]).all(axis=-1))


def test_the_clouds_are_seen_from_the_same_camera(pair, tmp_path):
    before, after = drawn(tmp_path, unchanged(pair, ROOM), ROOM)
    np.testing.assert_array_equal(before, after)
    assert before.shape == (240, 320, 4)
    assert 0.3 < (before[..., 3] == 255).mean() < 0.95
    assert set(np.unique(before[..., 3])) == {0, 255}


def test_the_after_cloud_is_registered(pair, tmp_path):
    shift = np.eye(4)
    shift[:3, 3] = [0.4, -0.3, 0.2]
    changes = dataclasses.replace(unchanged(pair, ROOM), registration=Registration(shift, applied=True))
    before, after = drawn(tmp_path, changes, ROOM, ROOM - shift[:3, 3])
    assert (before != after).any(axis=-1).mean() < 0.01


@pytest.mark.parametrize("kind", list(KIND_COLORS))
def test_a_single_changed_point_behind_a_wall_is_seen_in_its_color(pair, tmp_path, kind):
    hidden = int(np.argmax(FLOOR[:, 1]))
    before, after = drawn(tmp_path, with_change(pair, ROOM, [hidden], kind), ROOM)
    color = color_bytes(KIND_COLORS[kind])
    assert len(pixels_of(before, color)) == ThumbnailSettings().changed_square ** 2
    top, left = pixels_of(before, color).min(axis=0)
    assert (before[top - 1, left] == 255).all()
    assert not len(pixels_of(after, color))


def test_a_change_far_from_everything_is_in_the_frame(pair, tmp_path):
    points = np.concatenate([ROOM, [[30.0, 3, 1]]])
    before, _ = drawn(tmp_path, with_change(pair, points, [len(points) - 1]), points)
    color = color_bytes(KIND_COLORS["disappeared"])
    assert len(pixels_of(before, color)) == ThumbnailSettings().changed_square ** 2


@pytest.mark.parametrize(
    "points",
    [ROOM[:1], ROOM[[5, 5, 5]], ROOM * [1, 1, 0], ROOM * [1, 0, 0], ROOM * 1e-9, ROOM * 1e9],
    ids=["point", "coincident", "flat", "line", "tiny", "huge"],
)
def test_any_cloud_has_a_thumbnail(pair, tmp_path, points):
    image, _ = drawn(tmp_path, unchanged(pair, points), points)
    assert (image[..., 3] == 255).sum() >= ThumbnailSettings().largest_square ** 2


def test_survey_coordinates_keep_their_digits(pair, tmp_path):
    near, _ = drawn(tmp_path, unchanged(pair, ROOM), ROOM)
    far, _ = drawn(tmp_path, unchanged(pair, ROOM), ROOM + OFFSET)
    assert (near != far).any(axis=-1).mean() < 0.01


def test_the_scan_s_own_colors_are_recognised(pair, tmp_path):
    red, blue = [220, 30, 30], [30, 30, 220]
    colors = np.where(np.arange(len(ROOM))[:, None] < len(FLOOR), red, blue).astype(np.uint8)
    own, _ = drawn(tmp_path, unchanged(pair, ROOM), ROOM, colors=colors)
    grey, _ = drawn(tmp_path, unchanged(pair, ROOM), ROOM)
    reds, blues = (own[own[..., 3] > 0][:, channel].astype(int) for channel in (0, 2))
    assert ((reds - blues) > 30).mean() > 0.1
    assert ((blues - reds) > 30).mean() > 0.1
    assert (grey[..., 0] == grey[..., 2]).all()


def test_colors_that_tell_nothing_are_left_out(pair, tmp_path):
    white = np.full((len(ROOM), 3), 255, np.uint8)
    image, _ = drawn(tmp_path, unchanged(pair, ROOM), ROOM, colors=white)
    np.testing.assert_array_equal(image, drawn(tmp_path, unchanged(pair, ROOM), ROOM)[0])


@pytest.mark.parametrize("colors", [None, RANDOM.integers(0, 256, ROOM.shape).astype(np.uint8)], ids=["grey", "color"])
def test_everything_changed(pair, tmp_path, colors):
    changes = with_change(pair, ROOM, np.arange(len(ROOM)))
    image, _ = drawn(tmp_path, changes, ROOM, colors=colors)
    shown = {tuple(color) for color in image[image[..., 3] > 0][:, :3].tolist()}
    assert shown == {(255, 255, 255), color_bytes(KIND_COLORS["disappeared"])}


def test_the_same_clouds_give_the_same_small_files(pair, tmp_path):
    points = np.repeat(ROOM, 5, axis=0) + np.random.default_rng(0).normal(0, 0.01, (5 * len(ROOM), 3))
    contents = []
    for _ in range(2):
        drawn(tmp_path, with_change(pair, points, np.arange(50)), points)
        contents.append([(tmp_path / name).read_bytes() for name in ("before.png", "after.png")])
    assert contents[0] == contents[1]
    assert all(len(content) < 30_000 for content in contents[0])
    # No time, no name of a program.
    assert chunks(contents[0][0]) == [b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"]


def chunks(png):
    """The names of the chunks of a PNG file, each once."""
    stream, names = io.BytesIO(png[8:]), []
    while head := stream.read(8):
        length, name = struct.unpack(">I4s", head)
        stream.seek(length + 4, io.SEEK_CUR)
        names += [] if name in names else [name]
    return names


def test_other_clouds_than_those_of_the_changes_are_refused(pair, tmp_path):
    with pytest.raises(InputError, match=r"before: has 12000 points, the changes have labels for 400"):
        drawn(tmp_path, pair[2], ROOM)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_missing_is_named(pair, tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        drawn(tmp_path / "nowhere", unchanged(pair, ROOM), ROOM)
