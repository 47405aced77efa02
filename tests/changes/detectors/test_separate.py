import json

import jax
import numpy as np
import pytest

from gmmjax import DetectionConfig, InputError, InputWarning, PointCloud, detect_changes
from gmmjax.evaluation import score_pair
from gmmjax.scenes import random_scene

# Small and few, so that the whole file shares two compiled fits.
CONFIG = DetectionConfig(method="transport", restarts=2)


@pytest.fixture(scope="module")
def scene():
    return random_scene(jax.random.key(11), appeared=1, disappeared=1, points=250)


@pytest.fixture(scope="module")
def changes(scene):
    return detect_changes(scene.before, scene.after, method="transport", config=CONFIG)


def test_finds_what_is_gone_and_what_is_new(scene, changes):
    scores = score_pair(changes.labels_before, changes.labels_after, scene.truth_before, scene.truth_after)
    assert scores.f1 == 1 and scores.point_f1 > 0.97
    assert sorted(change.kind for change in changes.items) == ["appeared", "disappeared"]
    for change in changes.items:
        assert change.probability == 1 and change.point_count > 230
    gone = next(change for change in changes.items if change.kind == "disappeared")
    assert np.linalg.norm(gone.mean - scene.mixture_before.means[0]) < 0.1
    assert changes.emd > 0.1
    assert changes.config.method == "transport" and changes.config.restarts == 2


def test_record_is_consistent(scene, changes):
    assert changes.labels_before.shape == (1250,) and changes.labels_after.shape == (1250,)
    for labels, probability in (
        (changes.labels_before, changes.probability_before),
        (changes.labels_after, changes.probability_after),
    ):
        assert ((probability >= 0) & (probability <= 1)).all()
        assert (probability[labels >= 0] >= 0.5).all()
    for index, change in enumerate(changes.items):
        labels = changes.labels_after if change.kind == "appeared" else changes.labels_before
        assert (labels == index).sum() == change.point_count
    assert changes.diagnostics["before"]["points"] == 1250
    assert set(changes.diagnostics["seconds"]) == {"preparation", "fits", "comparison", "labels"}


@pytest.mark.slow
def test_greedy_finds_one_kind():
    scene = random_scene(jax.random.key(12), appeared=2, points=250)
    changes = detect_changes(scene.before, scene.after, method="greedy", config=CONFIG)
    scores = score_pair(changes.labels_before, changes.labels_after, scene.truth_before, scene.truth_after)
    assert scores.f1 == 1
    only_gone = detect_changes(
        scene.before, scene.after, config=DetectionConfig(method="greedy", restarts=2, kinds="disappeared")
    )
    assert not only_gone.items and (only_gone.labels_after == -1).all()


@pytest.mark.slow
def test_settings_reach_the_detection(scene):
    """A floor thickens every Gaussian, a high penalty matches everything, and the outlier filter can be off."""
    thick = detect_changes(
        scene.before,
        scene.after,
        method="transport",
        config=DetectionConfig(method="transport", restarts=2, noise_floor=0.4),
    )
    assert thick.items
    assert all(np.linalg.eigvalsh(change.covariance).min() >= 0.16 for change in thick.items)
    matched = detect_changes(
        scene.before,
        scene.after,
        method="transport",
        config=DetectionConfig(method="transport", restarts=2, penalty=100.0),
    )
    assert not matched.items
    stray = np.concatenate([scene.before, [[30.0, 30.0, 30.0]]])
    filtered = detect_changes(stray, scene.after, config=CONFIG)
    unfiltered = detect_changes(
        stray, scene.after, config=DetectionConfig(method="transport", restarts=2, outlier_neighbours=0)
    )
    assert filtered.diagnostics["before"]["outliers"] > 0
    assert unfiltered.diagnostics["before"]["outliers"] == 0
    assert unfiltered.diagnostics["before"]["points_fitted"] == 1251
    assert unfiltered.diagnostics["before"]["restarts_failed"] == 0


def samples(name):
    """Two clouds of 1,250 points of one scene, of which many ways to cut it into Gaussians are as good."""
    random = np.random.default_rng(0)
    before = random.uniform(size=(1250, 3))
    after = before.copy()
    if name != "equal":
        after[1125:] = random.uniform(size=(125, 3))
    if name == "mostly one place":
        before[:1125] = after[:1125] = 0.5
    return before, after


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"),
    [
        ("equal", "transport"),
        ("mostly equal", "transport"),
        ("mostly one place", "transport"),
        ("mostly one place", "greedy"),
    ],
)
def test_nothing_is_found_where_nothing_changed(name, method):
    before, after = samples(name)
    changes = detect_changes(before, after, method=method, config=CONFIG)
    assert changes.items == ()
    assert (changes.probability_before < 0.5).all() and (changes.probability_after < 0.5).all()


@pytest.mark.slow
def test_outside_the_crop_box_nothing_changes(scene, changes):
    """A box that holds the appeared Gaussian, and half of the rest."""
    appeared = next(change for change in changes.items if change.kind == "appeared")
    lower, upper = np.full(3, -9.0), np.full(3, 9.0)
    axis = int(np.abs(appeared.mean).argmax())
    (lower if appeared.mean[axis] > 0 else upper)[axis] = 0.0
    config = DetectionConfig(method="transport", restarts=2, crop=(*lower.tolist(), *upper.tolist()))
    before = np.insert(scene.before, 3, np.nan, axis=0)
    with pytest.warns(InputWarning, match="1 of 1,251 rows of the before cloud"):
        cropped = detect_changes(before, scene.after, method="transport", config=config)
    outside = ~((scene.after >= lower) & (scene.after <= upper)).all(axis=1)
    assert outside.any() and (cropped.labels_after[outside] == -1).all()
    assert (cropped.probability_after[outside] == 0).all()
    assert cropped.labels_before.shape == (1251,)
    assert cropped.diagnostics["before"]["rows_dropped"] == 1
    assert cropped.diagnostics["after"]["cropped"] == outside.sum()
    assert (cropped.labels_after[scene.truth_after >= 0] >= 0).mean() > 0.9
    assert DetectionConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config


@pytest.mark.slow
def test_large_clouds_are_reduced_and_every_point_is_labelled():
    scene = random_scene(jax.random.key(11), appeared=1, points=400)
    config = DetectionConfig(method="transport", restarts=2, max_points=1250)
    changes = detect_changes(scene.before, scene.after, config=config)
    assert changes.diagnostics["voxel_size"] > 0
    assert changes.diagnostics["after"]["points_fitted"] <= 1250
    assert len(changes.labels_after) == 2400
    scores = score_pair(changes.labels_before, changes.labels_after, scene.truth_before, scene.truth_after)
    assert scores.f1 == 1


@pytest.mark.slow
def test_a_voxel_of_many_points_is_no_gaussian():
    """One Gaussian in a grid as coarse as a tenth of it is still one."""
    random = np.random.default_rng(0)
    before, after = random.normal(size=(2, 6000, 3))
    changes = detect_changes(
        before, after, config=DetectionConfig(method="transport", restarts=2, voxel_size=0.4, max_components=20)
    )
    assert changes.diagnostics["before"]["components"] == [1, 1]
    assert not changes.items


def test_planes_work(scene):
    """Floors are planes."""
    flat = np.array([1, 1, 0])
    changes = detect_changes(scene.before * flat, scene.after * flat, method="transport", config=CONFIG)
    assert np.isfinite(changes.probability_after).all()
    assert {change.kind for change in changes.items} == {"appeared", "disappeared"}


@pytest.mark.parametrize(
    ("before", "message"),
    [
        (np.zeros((0, 3)), "before: has 0 points.*at least 10"),
        (np.zeros((1, 3)), "before: has 1 point with"),
        (np.arange(9.0).reshape(3, 3), "before: has 3 points"),
        (np.ones((50, 3)), "before: all 50 points are equal"),
        (np.full((50, 3), np.nan), "before: has 0 points"),
        (np.zeros((50, 2)), r"before: must have shape \[N, 3\]"),
        (np.full((50, 3), "x"), "before: is 'x', which is no array of points"),
        (PointCloud.from_rows(np.ones((50, 3)), source="flat.ply"), r"before \(flat.ply\): all 50 points"),
    ],
)
def test_clouds_that_cannot_be_compared_are_named(scene, before, message):
    with pytest.raises(InputError, match=message):
        detect_changes(before, scene.after, config=CONFIG)


def test_too_many_components_are_refused(scene):
    with pytest.raises(InputError, match=r"max_components=2000 is more than the 1.*choose at most 12"):
        detect_changes(scene.before, scene.after, config=DetectionConfig(method="transport", max_components=2000))


@pytest.mark.slow
def test_small_clouds_lower_the_number_of_components():
    random = np.random.default_rng(0)
    changes = detect_changes(random.normal(size=(40, 3)), random.normal(size=(45, 3)), config=CONFIG)
    assert changes.diagnostics["max_components"] <= 4


def test_disjoint_extents_are_refused(scene):
    with pytest.raises(InputError, match="do not overlap"):
        detect_changes(scene.before, scene.after + 100, config=CONFIG)
