from types import SimpleNamespace

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.surveys import localised_map
from gmmjax.thesis.laboratory import THINGS, clouds, lab_cloud


def in_the_scene(cloud):
    return cloud.points @ cloud.to_scene[:3, :3].T + cloud.to_scene[:3, 3]


def test_a_localised_map_has_a_point_for_a_voxel_and_its_views_see_them(recordings):
    for cloud in (lab_cloud(recording, "localised") for recording in recordings):
        assert len(np.unique(np.floor(cloud.points / 0.01), axis=0)) > 0.8 * len(cloud.points)
        assert len(cloud.views) == 8
        assert cloud.could_see(cloud).mean() > 0.95


def test_a_vertex_lies_on_the_thing_of_the_points_around_it(recordings, monkeypatch):
    """Without Open3D: every fortieth measured point in place of the vertices of the fused surface."""

    def surface(frames, trajectory, voxel_size):
        return SimpleNamespace(points=localised_map(frames, trajectory).points[::40])

    monkeypatch.setattr(clouds, "volumetric_map", surface)
    cloud = lab_cloud(recordings[1], "volumetric")
    places = in_the_scene(cloud)
    assert len(cloud.things) == len(cloud.points) > 3000
    for name in ("cargo bag", "gear box", "back wall"):
        own = cloud.things == THINGS.index(name)
        inside = np.any([solid.contains(places[own], 0.05) for solid in cloud.laboratory.things[name]], axis=0)
        assert own.sum() > 20 and inside.mean() > 0.97


def test_single_frames_are_no_map(recordings, as_users):
    with pytest.raises(InputError, match="kind='frame' is unknown; choose from volumetric, localised"):
        lab_cloud(recordings[0], "frame")
