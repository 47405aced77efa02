import base64
import dataclasses

import numpy as np

from gmmjax.clouds import PointCloud
from gmmjax.reporting.framing import shown_range
from gmmjax.reporting.scene_plot import scene_views
from tests.reporting.conftest import labelled


def decoded(array):
    return np.frombuffer(base64.b64decode(array["bdata"]), {"f4": "<f4", "u1": "u1"}[array["dtype"]])


def test_survey_coordinates_keep_their_digits(pair):
    before, after, changes = pair
    lower, upper = shown_range(np.concatenate([before.points, after.points]), changes)
    far = [dataclasses.replace(cloud, points=cloud.points + 1e6) for cloud in (before, after)]
    boxes = tuple(
        dataclasses.replace(item, box=dataclasses.replace(item.box, centre=item.box.centre + 1e6))
        for item in changes.items
    )
    near_views = scene_views(before, after, changes)["views"]
    far_views = scene_views(*far, dataclasses.replace(changes, items=boxes))["views"]
    for near_trace, far_trace in zip(near_views["after"], far_views["after"], strict=True):
        np.testing.assert_allclose(decoded(far_trace["x"]), decoded(near_trace["x"]), atol=1e-5)
    centre = (lower + upper) / 2
    changed = near_views["after"][2]
    np.testing.assert_allclose(decoded(changed["y"]) + centre[1], after.points[60:130, 1], atol=1e-5)


def test_one_stray_point_does_not_shrink_the_view(pair):
    before, after, changes = pair
    points = np.concatenate([np.repeat(before.points, 5, axis=0), [[1e4, 0, 0]]])
    lower, upper = shown_range(points, changes)
    assert (upper - lower).max() < 20
    assert (lower < before.points.min(axis=0)).all()
    del after


def test_boxes_have_twelve_edges(pair):
    traces = scene_views(*pair)["views"]["before"]
    box = next(trace for trace in traces if trace["mode"] == "lines")
    lines = np.stack([decoded(box[axis]) for axis in "xyz"], axis=1).reshape(12, 3, 3)
    lengths = np.sort(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1))
    np.testing.assert_allclose(lengths, np.sort(np.repeat(pair[2].items[0].box.extent, 4)), rtol=1e-5)
    assert np.isnan(lines[:, 2]).all()


def test_clouds_without_colours_are_darker_in_front(pair):
    random = np.random.default_rng(0)
    cloud = PointCloud.from_rows(np.c_[random.uniform(-0.3, 0.3, (300, 2)), random.uniform(1, 2, 300)])
    changes = labelled(pair[2], np.full(300, -1), np.full(300, -1), ())
    shade = decoded(scene_views(cloud, cloud, changes)["views"]["before"][0]["marker"]["color"])
    assert np.corrcoef(shade, cloud.points[:, 2])[0, 1] > 0.9
