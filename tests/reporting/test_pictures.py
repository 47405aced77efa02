import dataclasses
import io

import numpy as np
import pytest
from PIL import Image

from gmmjax.changes import DetectionConfig, Registration
from gmmjax.clouds import PointCloud
from gmmjax.errors import InputError
from gmmjax.pair import Pair
from gmmjax.reporting import write_thumbnails
from gmmjax.reporting.palette import KIND_COLORS, color_bytes, stretched
from gmmjax.reporting.pictures import Pictures, PictureSettings
from tests.reporting.conftest import change, labelled

SMALL = PictureSettings(width=120, height=90)
RANDOM = np.random.default_rng(3)
# A room of 8 m with a wall in front, as the first view sees it: from the side of negative y.
FLOOR = RANDOM.uniform([0, 0, 0], [8, 6, 0.02], (6000, 3))
FRONT = RANDOM.uniform([0, 0, 0], [8, 0.02, 3], (6000, 3))
ROOM = np.concatenate([FLOOR, FRONT])


@pytest.fixture(scope="module")
def room(pair):
    """A floor with a wall, and a crate behind it that appeared."""
    random = np.random.default_rng(2)
    floor = np.c_[random.uniform(-4, 4, (6000, 2)), np.zeros(6000)]
    wall = np.c_[random.uniform(-4, 4, 3000), np.full(3000, -1.2), random.uniform(0, 3, 3000)]
    crate = random.uniform([-0.5, -0.5, 0], [0.5, 0.5, 1], (800, 3))
    before, after = np.concatenate([floor, wall]), np.concatenate([floor, wall, crate])
    labels = np.r_[np.full(9000, -1), np.zeros(800, int)]
    changes = labelled(pair[2], np.full(9000, -1), labels, (change("appeared", crate),))
    return Pair(PointCloud.from_rows(before), PointCloud.from_rows(after)), changes


def pixels(picture):
    """Red, green, blue and opacity of a WebP file."""
    return np.asarray(Image.open(io.BytesIO(picture), formats=["WEBP"]).convert("RGBA")).astype(int)


def greenish(picture):
    """Pixels in the colour of what appeared, #009E73, or tinted with it."""
    shown = pixels(picture)
    return (shown[..., 3] > 128) & (shown[..., 1] > shown[..., 0] + 40)


def test_a_change_behind_a_wall_is_seen(room):
    pictures = Pictures(*room, SMALL).close_ups((0,))
    assert greenish(pictures.after).sum() > 300
    # Before, there is only the outline of where it will be.
    assert 10 < greenish(pictures.before).sum() < greenish(pictures.after).sum() / 2


def test_before_and_after_are_from_the_same_camera(room):
    clouds, changes = room
    nothing = labelled(changes, changes.labels_before, np.full(9800, -1), changes.items)
    crate = labelled(changes, changes.labels_after, changes.labels_after, changes.items)
    same = Pictures(Pair(clouds.after, clouds.after), crate, SMALL).close_ups((0,))
    assert same.before == same.after
    # A record without the labels still has its box to look at.
    assert pixels(Pictures(clouds, nothing, SMALL).close_ups((0,)).after)[..., 3].max() == 255


def test_the_same_input_gives_the_same_picture(room):
    assert Pictures(*room, SMALL).close_ups((0,)) == Pictures(*room, SMALL).close_ups((0,))


def test_survey_coordinates_change_nothing(room):
    clouds, changes = room
    far = clouds.map(lambda cloud: dataclasses.replace(cloud, points=cloud.points + np.array([5e6, 4e5, 100])))
    near, moved = Pictures(clouds, changes, SMALL).close_ups((0,)), Pictures(far, changes, SMALL).close_ups((0,))
    assert np.abs(greenish(near.after).sum() - greenish(moved.after).sum()) < 20


def test_the_overview_has_every_change_in_its_colour(pair):
    before, after, changes = pair
    pictures = Pictures(Pair(before, after), changes, SMALL).overview()
    blueish = pixels(pictures.after)
    assert greenish(pictures.after).any()
    assert ((blueish[..., 2] > blueish[..., 0] + 60) & (blueish[..., 3] > 128)).any()


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.full((5, 3), 7.0)])
def test_a_cloud_of_one_place_has_pictures(pair, points):
    cloud = PointCloud.from_rows(points)
    labels = np.zeros(len(points), int)
    item = dataclasses.replace(
        pair[2].items[0], mean=points[0], box=dataclasses.replace(pair[2].items[0].box, extent=np.zeros(3))
    )
    changes = dataclasses.replace(labelled(pair[2], labels, labels, (item,)), config=DetectionConfig())
    pictures = Pictures(Pair(cloud, cloud), changes, SMALL)
    assert all(pixels(picture)[..., 3].max() == 255 for picture in (*pictures.close_ups((0,)), *pictures.overview()))


def thumbnails(folder, changes, before, after=None, colors=None):
    """Both thumbnails as arrays [height, width, RGBA]."""
    clouds = Pair(before, before if after is None else after)
    write_thumbnails(folder, clouds.map(lambda points: PointCloud.from_rows(points, colors=colors)), changes)
    return tuple(pixels((folder / name).read_bytes()) for name in ("before.webp", "after.webp"))


def unchanged(pair, points):
    return labelled(pair[2], np.full(len(points), -1), np.full(len(points), -1), ())


def with_change(pair, points, chosen, kind="disappeared"):
    """The chosen points of the before cloud are one change."""
    labels = np.where(np.isin(np.arange(len(points)), chosen), 0, -1)
    around = points[chosen].mean(axis=0) + np.random.default_rng(0).normal(0, 0.01, (20, 3))
    return labelled(pair[2], labels, np.full(len(points), -1), (change(kind, around),))


def near_color(image, color):
    """Where a picture has a colour, but for what the encoding loses."""
    return (image[..., 3] == 255) & (np.abs(image[..., :3] - color).max(axis=-1) < 40)


def test_thumbnails_show_both_clouds_from_one_camera(pair, tmp_path):
    before, after = thumbnails(tmp_path, unchanged(pair, ROOM), ROOM)
    np.testing.assert_array_equal(before, after)
    assert before.shape == (240, 320, 4)
    assert 0.3 < (before[..., 3] == 255).mean() < 0.95
    assert set(np.unique(before[..., 3])) == {0, 255}


def test_the_after_cloud_is_registered(pair, tmp_path):
    shift = np.eye(4)
    shift[:3, 3] = [0.4, -0.3, 0.2]
    changes = dataclasses.replace(unchanged(pair, ROOM), registration=Registration(shift, applied=True))
    before, after = thumbnails(tmp_path, changes, ROOM, ROOM - shift[:3, 3])
    assert (np.abs(before - after) > 40).any(axis=-1).mean() < 0.01


@pytest.mark.parametrize("kind", list(KIND_COLORS))
def test_a_single_changed_point_behind_a_wall_is_seen_in_its_color(pair, tmp_path, kind):
    hidden = int(np.argmax(FLOOR[:, 1]))
    before, after = thumbnails(tmp_path, with_change(pair, ROOM, [hidden], kind), ROOM)
    seen = [near_color(image, color_bytes(KIND_COLORS[kind])) for image in (before, after)]
    assert 12 <= seen[0].sum() <= 64 and not seen[1].any()
    top, left = np.argwhere(seen[0]).min(axis=0)
    assert near_color(before, (255, 255, 255))[top - 3 : top + 9, left - 3 : left + 9].sum() > 20


def test_a_change_far_from_everything_is_in_the_frame(pair, tmp_path):
    points = np.concatenate([ROOM, [[30.0, 3, 1]]])
    before, _ = thumbnails(tmp_path, with_change(pair, points, [len(points) - 1]), points)
    assert near_color(before, color_bytes(KIND_COLORS["disappeared"])).sum() >= 12


@pytest.mark.parametrize(
    "points",
    [ROOM[:1], ROOM[[5, 5, 5]], ROOM * [1, 1, 0], ROOM * [1, 0, 0], ROOM * 1e-9, ROOM * 1e9],
    ids=["point", "coincident", "flat", "line", "tiny", "huge"],
)
def test_any_cloud_has_a_thumbnail(pair, tmp_path, points):
    image, _ = thumbnails(tmp_path, unchanged(pair, points), points)
    assert (image[..., 3] == 255).sum() >= 36


def test_survey_coordinates_keep_their_digits(pair, tmp_path):
    near, _ = thumbnails(tmp_path, unchanged(pair, ROOM), ROOM)
    far, _ = thumbnails(tmp_path, unchanged(pair, ROOM), ROOM + np.array([5e6, 4e6, 1e3]))
    assert (np.abs(near - far) > 40).any(axis=-1).mean() < 0.01


def test_the_scan_s_own_colors_are_recognised(pair, tmp_path):
    colors = np.where(np.arange(len(ROOM))[:, None] < len(FLOOR), [220, 30, 30], [30, 30, 220]).astype(np.uint8)
    own, _ = thumbnails(tmp_path, unchanged(pair, ROOM), ROOM, colors=colors)
    red, blue = (own[own[..., 3] > 0][:, channel] for channel in (0, 2))
    assert ((red - blue) > 30).mean() > 0.1 and ((blue - red) > 30).mean() > 0.1


def test_colors_that_tell_nothing_are_left_out(pair, tmp_path):
    white = np.full((len(ROOM), 3), 255, np.uint8)
    image, _ = thumbnails(tmp_path, unchanged(pair, ROOM), ROOM, colors=white)
    np.testing.assert_array_equal(image, thumbnails(tmp_path, unchanged(pair, ROOM), ROOM)[0])


def test_everything_changed(pair, tmp_path):
    image, _ = thumbnails(tmp_path, with_change(pair, ROOM, np.arange(len(ROOM))), ROOM)
    assert near_color(image, color_bytes(KIND_COLORS["disappeared"])).sum() > 0.8 * (image[..., 3] > 0).sum()


def test_the_same_clouds_give_the_same_small_files(pair, tmp_path):
    points = np.repeat(ROOM, 5, axis=0) + np.random.default_rng(0).normal(0, 0.01, (5 * len(ROOM), 3))
    contents = []
    for _ in range(2):
        thumbnails(tmp_path, with_change(pair, points, np.arange(50)), points)
        contents.append([(tmp_path / name).read_bytes() for name in ("before.webp", "after.webp")])
    assert contents[0] == contents[1]
    assert all(len(content) < 30_000 for content in contents[0])


def test_other_clouds_than_those_of_the_changes_are_refused(pair, tmp_path):
    with pytest.raises(InputError, match=r"before: has 12,000 points, the changes have labels for 400"):
        thumbnails(tmp_path, pair[2], ROOM)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_missing_is_named(pair, tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        thumbnails(tmp_path / "nowhere", unchanged(pair, ROOM), ROOM)


def test_values_without_a_range_are_in_the_middle_of_the_scale():
    np.testing.assert_array_equal(stretched(np.full(3, 7.0)), 0.5)
    assert stretched(np.arange(101.0))[[0, 100]].tolist() == [0.0, 1.0]
