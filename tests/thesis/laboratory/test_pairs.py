from types import SimpleNamespace

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.surveys import localised_map
from gmmjax.thesis.laboratory import THINGS, lab_cloud, lab_frames, lab_pair, lab_sources, labelled, pairs

OBJECTS = {"robot", "cargo bag", "gear box"}


@pytest.fixture(scope="module")
def clouds(recordings):
    return [lab_cloud(recording, "localised") for recording in recordings]


@pytest.fixture(scope="module")
def pair(clouds):
    return labelled("pair", *clouds)


def named(labels):
    return {THINGS[label] for label in np.unique(labels) if label >= 0}


@pytest.mark.slow
def test_the_truth_is_what_came(clouds, pair):
    assert (pair.before.truth == -1).all() and named(pair.after.truth) == OBJECTS
    places = clouds[1].in_scene()
    for name in OBJECTS:
        solids, own = clouds[1].laboratory.things[name], pair.after.truth == THINGS.index(name)
        assert np.any([solid.contains(places[own], 0.06) for solid in solids], axis=0).mean() > 0.98
        assert not any(solid.contains(places[pair.after.truth == -1], -0.06).any() for solid in solids)
    assert pair.before.not_counted == pair.after.not_counted == frozenset()


def test_what_a_new_object_covers_is_unseen(clouds, pair):
    """The floor below the gear box, which only the survey without it sees."""
    (box,) = clouds[1].laboratory.things["gear box"]
    places = clouds[0].in_scene()
    covered = (np.linalg.norm((places - box.centre)[:, :2], axis=1) < 0.1) & (np.abs(places[:, 2]) < 0.02)
    assert covered.sum() > 20 and pair.before.unseen[covered].all()
    assert pair.before.unseen.mean() < 0.3


def test_a_localised_map_has_a_point_for_a_voxel_and_its_views_see_them(clouds):
    # Without objects more of the points lie at edges, which errors of the poses hide.
    for cloud, seen in zip(clouds, (0.94, 0.98), strict=True):
        assert len(np.unique(np.floor(cloud.points / 0.01), axis=0)) > 0.8 * len(cloud.points)
        assert len(cloud.views) == 8
        assert cloud.could_see(cloud).mean() > seen


def test_a_vertex_lies_on_the_thing_of_the_points_around_it(recordings, monkeypatch):
    """Without Open3D: every fortieth measured point in place of the vertices of the fused surface."""

    def surface(frames, trajectory, voxel_size):
        return SimpleNamespace(points=localised_map(frames, trajectory).points[::40])

    monkeypatch.setattr(pairs, "volumetric_map", surface)
    cloud = lab_cloud(recordings[1], "volumetric")
    places = cloud.in_scene()
    assert len(cloud.things) == len(cloud.points) > 3000
    for name in ("cargo bag", "gear box", "back wall"):
        own = cloud.things == THINGS.index(name)
        inside = np.any([solid.contains(places[own], 0.05) for solid in cloud.laboratory.things[name]], axis=0)
        assert own.sum() > 20 and inside.mean() > 0.97


def test_a_volumetric_map_has_the_same_truth(recordings, open3d):
    cloud = lab_cloud(recordings[1], "volumetric")
    own = cloud.things == THINGS.index("gear box")
    assert own.sum() > 500
    assert cloud.laboratory.things["gear box"][0].contains(cloud.in_scene()[own], 0.05).mean() > 0.98


@pytest.mark.parametrize("seed", range(4))
def test_single_frames_are_of_something_that_changed(seed):
    clouds = lab_frames(("run5", "run4"), seed)
    pair = labelled("frames", *clouds)
    assert (pair.after.truth >= 0).sum() > 500 and (pair.before.truth == -1).all()
    assert 0 < np.linalg.norm(clouds[0].to_scene[:3, 3] - clouds[1].to_scene[:3, 3]) < 0.06
    # Objects that are out of the picture are not asked for.
    assert OBJECTS - named(pair.after.truth) <= {THINGS[label] for label in pair.after.not_counted}
    np.testing.assert_array_equal(lab_pair("frame", ("run5", "run4"), seed).after.points, pair.after.points)


def test_seeds_go_round_the_runs_there_and_back():
    sources = lab_sources(range(1000, 1008), "localised")
    assert len({source.name.split(",")[0] for source in sources}) == 8
    for source in sources:
        appeared = source.name.startswith("run5 to")
        assert source.condition == ("appeared" if appeared else "disappeared")
        assert appeared or "to run5" in source.name


def test_a_pair_has_all_that_scores_need():
    for source in lab_sources([0, 4], "frame"):
        pair = source.load()
        changed, other = (pair.after, pair.before) if source.condition == "appeared" else (pair.before, pair.after)
        assert (changed.truth >= 0).any() and (other.truth < 0).all()
        for cloud in (changed, other):
            assert len(cloud.views) == 1
            assert len(cloud.points) == len(cloud.truth) == len(cloud.unseen) == len(cloud.things)
            assert not named(cloud.things[cloud.truth < 0]) & OBJECTS


def test_what_cannot_be_made_is_named(recordings, monkeypatch, as_users):
    def missing(purpose):
        raise InputError(f"{purpose} needs Open3D: pip install '.[open3d]'")

    monkeypatch.setattr(pairs, "load_open3d", missing)
    with pytest.raises(InputError, match="simulating volumetric maps needs Open3D"):
        lab_sources([0], "volumetric")
    with pytest.raises(InputError, match=r"kind='mesh' is unknown; choose from frame, volumetric, localised"):
        lab_pair("mesh", ("run5", "run1"), 0)
    with pytest.raises(InputError, match="kind='frame' is unknown; choose from volumetric, localised"):
        lab_cloud(recordings[0], "frame")
