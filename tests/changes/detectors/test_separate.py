import json

import jax
import numpy as np
import pytest

from gmmjax import DetectionConfig, InputError, InputWarning, PointCloud, detect_changes, read_cloud
from gmmjax.evaluation import score_pair
from gmmjax.scenes import random_scene
from tests.mixtures.examples import random_rotation

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


def test_greedy_finds_one_kind():
    scene = random_scene(jax.random.key(12), appeared=2, points=250)
    changes = detect_changes(scene.before, scene.after, method="greedy", config=CONFIG)
    scores = score_pair(changes.labels_before, changes.labels_after, scene.truth_before, scene.truth_after)
    assert scores.f1 == 1
    only_gone = detect_changes(
        scene.before, scene.after, config=DetectionConfig(method="greedy", restarts=2, kinds="disappeared")
    )
    assert not only_gone.items and (only_gone.labels_after == -1).all()


@pytest.mark.parametrize("kinds", ["appeared", "disappeared"])
def test_transport_looks_for_the_kinds_that_are_wanted(scene, kinds):
    config = DetectionConfig(restarts=2, kinds=kinds)
    found = detect_changes(scene.before, scene.after, method="transport", config=config)
    assert {change.kind for change in found.items} == {kinds}
    other = found.probability_before if kinds == "appeared" else found.probability_after
    assert (other == 0).all()


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


def test_backwards_in_time_appeared_is_disappeared(scene, changes):
    swapped = detect_changes(scene.after, scene.before, method="transport", config=CONFIG)
    kinds = {change.kind: change.point_count for change in changes.items}
    backwards = {change.kind: change.point_count for change in swapped.items}
    assert backwards == {"appeared": kinds["disappeared"], "disappeared": kinds["appeared"]}
    np.testing.assert_array_equal(swapped.probability_before, changes.probability_after)
    np.testing.assert_array_equal(swapped.probability_after, changes.probability_before)


def test_permuting_points_permutes_labels(scene, changes):
    """To the last digit."""
    random = np.random.default_rng(0)
    orders = random.permutation(1250), random.permutation(1250)
    permuted = detect_changes(scene.before[orders[0]], scene.after[orders[1]], method="transport", config=CONFIG)
    for side, order in zip(("before", "after"), orders, strict=True):
        for name in ("labels", "probability"):
            expected = getattr(changes, f"{name}_{side}")[order]
            np.testing.assert_array_equal(getattr(permuted, f"{name}_{side}"), expected)
    assert permuted.emd == changes.emd


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


def test_a_rigid_motion_and_another_unit_move_the_changes(scene, changes):
    rotation, shift = random_rotation(), np.array([1e6, -2e6, 3e5])
    moved = detect_changes(
        1000 * scene.before @ rotation.T + shift,
        1000 * scene.after @ rotation.T + shift,
        method="transport",
        config=CONFIG,
    )
    # The outlier filter and the seeds see the same distances.
    np.testing.assert_array_equal(moved.labels_before, changes.labels_before)
    np.testing.assert_array_equal(moved.labels_after, changes.labels_after)
    np.testing.assert_allclose(moved.emd, 1000 * changes.emd, rtol=1e-4)
    for there, here in zip(moved.items, changes.items, strict=True):
        np.testing.assert_allclose(there.mean, 1000 * rotation @ here.mean + shift, atol=1e-2)
        np.testing.assert_allclose(there.box.extent, 1000 * here.box.extent, rtol=1e-3)


def test_rows_without_a_position_are_unchanged_and_counted(scene, changes):
    before = np.insert(scene.before, [0, 700], [[np.nan, 0, 0], [1, np.inf, 2]], axis=0)
    with pytest.warns(InputWarning, match="2 of 1,252 rows of the before cloud"):
        given = detect_changes(before, scene.after, method="transport", config=CONFIG)
    assert given.labels_before.shape == (1252,)
    np.testing.assert_array_equal(np.delete(given.labels_before, [0, 701]), changes.labels_before)
    assert (given.labels_before[[0, 701]] == -1).all() and (given.probability_before[[0, 701]] == 0).all()
    assert given.diagnostics["before"]["rows_dropped"] == 2
    cloud = PointCloud.from_rows(before, source="scan.ply")
    of_cloud = detect_changes(cloud, scene.after, method="transport", config=CONFIG)
    assert of_cloud.labels_before.shape == (1250,)
    assert of_cloud.diagnostics["before"] | {"source": None} == given.diagnostics["before"]


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


def test_large_clouds_are_reduced_and_every_point_is_labelled():
    scene = random_scene(jax.random.key(11), appeared=1, points=400)
    config = DetectionConfig(method="transport", restarts=2, max_points=1250)
    changes = detect_changes(scene.before, scene.after, config=config)
    assert changes.diagnostics["voxel_size"] > 0
    assert changes.diagnostics["after"]["points_fitted"] <= 1250
    assert len(changes.labels_after) == 2400
    scores = score_pair(changes.labels_before, changes.labels_after, scene.truth_before, scene.truth_after)
    assert scores.f1 == 1


def test_a_voxel_of_many_points_is_no_gaussian():
    """One Gaussian in a grid as coarse as a tenth of it is still one."""
    random = np.random.default_rng(0)
    before, after = random.normal(size=(2, 6000, 3))
    changes = detect_changes(
        before, after, config=DetectionConfig(method="transport", restarts=2, voxel_size=0.4, max_components=20)
    )
    assert changes.diagnostics["before"]["components"] == [1, 1]
    assert not changes.items


def test_the_same_seed_gives_the_same_result(scene, changes):
    again = detect_changes(scene.before, scene.after, method="transport", seed=0, config=CONFIG)
    np.testing.assert_array_equal(again.probability_after, changes.probability_after)
    assert again.config == changes.config


def test_progress_grows_to_one(scene):
    told = []
    detect_changes(scene.before, scene.after, config=CONFIG, progress=lambda stage, share: told.append((stage, share)))
    assert {stage for stage, _ in told} >= {"Filtering the points", "Fitting the mixtures", "Labelling the points"}
    assert told[-1][1] == 1 and sorted(share for _, share in told)[0] == 0


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


def test_small_clouds_lower_the_number_of_components():
    random = np.random.default_rng(0)
    changes = detect_changes(random.normal(size=(40, 3)), random.normal(size=(45, 3)), config=CONFIG)
    assert changes.diagnostics["max_components"] <= 4


def test_disjoint_extents_are_refused(scene):
    with pytest.raises(InputError, match="do not overlap"):
        detect_changes(scene.before, scene.after + 100, config=CONFIG)


@pytest.mark.parametrize("method", ["greedy", "transport"])
def test_real_scans_give_well_formed_results(scan_pairs, method):
    """Labels for every point, in the order of the file; what is found is judged by the evaluation."""
    pair = scan_pairs[0]
    before, after = read_cloud(pair / "before.ply"), read_cloud(pair / "after.ply")
    config = DetectionConfig(method=method, restarts=1, max_points=1250)
    changes = detect_changes(before, after, config=config)
    assert changes.labels_before.shape == (len(before),) and changes.labels_after.shape == (len(after),)
    assert np.isfinite(changes.probability_before).all() and np.isfinite(changes.probability_after).all()
    assert changes.labels_after.max() < len(changes.items)
