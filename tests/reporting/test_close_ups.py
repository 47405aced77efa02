import base64
import dataclasses
import io

import numpy as np
import pytest

from gmmjax.changes import DetectionConfig
from gmmjax.clouds import PointCloud
from gmmjax.pair import Pair
from gmmjax.reporting.close_ups import CloseUps, CloseUpSettings
from tests.reporting.conftest import change, labelled

SMALL = CloseUpSettings(width=120, height=90)


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


def pixels(uri):
    from PIL import Image

    kind, content = uri.split(",")
    assert kind == "data:image/webp;base64"
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(content))).convert("RGBA")).astype(int)


def greenish(uri):
    """Pixels in the colour of what appeared, #009E73, or tinted with it."""
    picture = pixels(uri)
    return (picture[..., 3] > 128) & (picture[..., 1] > picture[..., 0] + 40)


def test_a_change_behind_a_wall_is_seen(room):
    pictures = CloseUps(*room, SMALL).of((0,))
    assert greenish(pictures.after).sum() > 300
    # Before, there is only the outline of where it will be.
    assert 10 < greenish(pictures.before).sum() < greenish(pictures.after).sum() / 2


def test_before_and_after_are_from_the_same_camera(room):
    clouds, changes = room
    nothing = labelled(changes, changes.labels_before, np.full(9800, -1), changes.items)
    crate = labelled(changes, changes.labels_after, changes.labels_after, changes.items)
    same = CloseUps(Pair(clouds.after, clouds.after), crate, SMALL).of((0,))
    assert same.before == same.after
    # A record without the labels still has its box to look at.
    assert pixels(CloseUps(clouds, nothing, SMALL).of((0,)).after)[..., 3].max() == 255


def test_the_same_input_gives_the_same_picture(room):
    assert CloseUps(*room, SMALL).of((0,)) == CloseUps(*room, SMALL).of((0,))


def test_survey_coordinates_change_nothing(room):
    clouds, changes = room
    far = clouds.map(lambda cloud: dataclasses.replace(cloud, points=cloud.points + np.array([5e6, 4e5, 100])))
    near, moved = CloseUps(clouds, changes, SMALL).of((0,)), CloseUps(far, changes, SMALL).of((0,))
    assert np.abs(greenish(near.after).sum() - greenish(moved.after).sum()) < 20


def test_the_overview_has_every_change_in_its_colour(pair):
    before, after, changes = pair
    pictures = CloseUps(Pair(before, after), changes, SMALL).overview()
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
    pictures = CloseUps(Pair(cloud, cloud), changes, SMALL)
    assert all(uri.startswith("data:") for uri in (*pictures.of((0,)), *pictures.overview()))
