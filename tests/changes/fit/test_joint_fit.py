import os
import subprocess
import sys

import jax
import numpy as np
import pytest

from gmmjax.changes.fit.joint_fit import (
    CHUNK,
    FramedPoints,
    JointFits,
    component_excess,
    fit_joint_restarts,
    mixtures_distance,
    point_excess,
    subsample,
)
from gmmjax.comparison.joint_mixture_model import LabelledPoints, joint_prior
from gmmjax.errors import ComputationError
from gmmjax.mixtures import FitSettings, WeightedPoints
from gmmjax.transport import exact_transport

SETTINGS = FitSettings(patience=0.05)
PRIOR = joint_prior(1e-3, 0.0)
# Of the Gaussians of `sourced`; the last one is new.
CENTRES = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0]])

# A posterior in a process of its own, because XLA starts its threads once. Prints its hash.
OF_THREADS = """
import hashlib
import numpy as np
from gmmjax.changes.fit.joint_fit import JointFits, component_excess
from gmmjax.comparison.joint_mixture import JointMixture
from gmmjax.mixtures import GaussianMixture, Standardisation
random = np.random.default_rng(0)
mixture = GaussianMixture(np.full((1, 25), 0.04), random.normal(size=(1, 25, 3)), np.tile(np.eye(3), (1, 25, 1, 1)),
    np.ones((1, 25), bool))
joint = JointMixture(mixture, random.uniform(0.1, 0.9, (1, 25)), np.full(1, 0.02), np.full(1, -3.0))
fits = JointFits(joint, np.zeros(1), np.ones(1), np.zeros(1, int), np.zeros(1), Standardisation(np.zeros(3), 1.0))
posterior, slots = component_excess(fits, random.normal(size=(9000, 3)), True, 0)
print(hashlib.sha256(posterior.tobytes() + slots.tobytes()).hexdigest())
"""


def sourced(size, seed=0):
    """Two Gaussians in both clouds and one in the after cloud alone."""
    random = np.random.default_rng(seed)
    number = random.integers(0, 3, size)
    points = random.standard_normal((size, 3)) * 0.3 + CENTRES[number]
    after = np.where(number == 2, 1.0, random.integers(0, 2, size).astype(float))
    return LabelledPoints(WeightedPoints(points, np.ones(size)), after)


def arrays(size, components, slots, *, points=None, restarts=range(2), prior=PRIOR, max_points=6000, progress=None):
    return fit_joint_restarts(
        FramedPoints.of(sourced(size) if points is None else points), key=jax.random.key(0), max_components=components,
        slots=slots, prior=prior, restarts=restarts, max_points=max_points, settings=SETTINGS, progress=progress,
    )  # fmt: skip


def fits(size, components, slots, *, points=None, **options):
    frame = FramedPoints.of(sourced(size) if points is None else points).frame
    return JointFits.of_arrays(arrays(size, components, slots, points=points, **options), frame)


def both(function, fits, points, after):
    """What both restarts say."""
    return [function(fits, points, after, restart) for restart in range(2)]


@pytest.mark.slow
def test_more_slots_change_nothing():
    few, many = fits(240, 6, 6), fits(240, 6, 12)
    np.testing.assert_allclose(many.message_length, few.message_length, rtol=1e-9)
    np.testing.assert_array_equal(many.joint.mixture.live.sum(axis=1), few.joint.mixture.live.sum(axis=1))
    assert not many.joint.mixture.live[:, 6:].any()
    assert mixtures_distance(many) == pytest.approx(mixtures_distance(few), rel=1e-9)


def test_clouds_of_other_sizes_and_components_share_a_program():
    mixtures_distance(fits(240, 6, 12))
    programs = len(jax.devices()[0].client.live_executables())
    for size, components in ((200, 10), (255, 12), (120, 3)):
        mixtures_distance(fits(size, components, 12))
    assert len(jax.devices()[0].client.live_executables()) == programs


def test_the_distance_is_the_mean_of_the_restarts():
    found = fits(240, 6, 12)
    expected = []
    for restart in range(2):
        joint = jax.tree.map(lambda leaf, index=restart: leaf[index], found.joint)
        weights = [joint.mixture.weights * share for share in (1 - joint.share_after, joint.share_after)]
        means = joint.mixture.means * found.frame.spread
        costs = np.linalg.norm(means[:, None] - means[None], axis=2)
        with jax.enable_x64(True):
            expected.append(float(exact_transport(*(own / own.sum() for own in weights), costs).cost))
    assert mixtures_distance(found) == pytest.approx(np.mean(expected), rel=1e-9)


@pytest.fixture(scope="module")
def found():
    return fits(240, 6, 12)


def test_points_of_the_new_gaussian_are_extra_in_the_after_cloud_alone(found):
    after, before = (np.stack(both(point_excess, found, CENTRES, own)) for own in (True, False))
    assert after.shape == before.shape == (2, 3)
    assert (after[:, 2] > 0.9).all() and (after[:, :2] < 0.3).all()
    assert (before[:, 2] == 0).all()


def test_component_excess_names_the_component_that_changed(found):
    excess, slots = (np.stack(parts) for parts in zip(*both(component_excess, found, CENTRES, True), strict=True))
    assert (excess[:, 2] > 0.9).all() and (excess[:, :2] < 0.3).all()
    means = found.joint.mixture.means[np.arange(2), slots[:, 2]] * found.frame.spread + found.frame.origin
    np.testing.assert_allclose(means, np.tile(CENTRES[2], (2, 1)), atol=0.2)


def test_points_of_further_chunks_are_judged_like_those_of_the_first(found):
    many = np.resize(CENTRES, (CHUNK + 4, 3))
    np.testing.assert_array_equal(point_excess(found, many, True, 0)[-3:], point_excess(found, many[-3:], True, 0))
    assert point_excess(found, many[:0], True, 0).shape == (0,)


@pytest.mark.slow
def test_the_number_of_threads_changes_no_bit():
    """A pair has the same result by a worker of one core as by one of several."""
    hashes = set()
    for threads in ("1", "4"):
        environment = {**os.environ, "NPROC": threads}
        done = subprocess.run(
            [sys.executable, "-c", OF_THREADS], env=environment, capture_output=True, text=True, check=True
        )
        hashes.add(done.stdout)
    assert len(hashes) == 1


def test_the_order_of_the_points_changes_nothing(found):
    order = np.random.default_rng(1).permutation(240)
    again = fits(240, 6, 12, points=jax.tree.map(lambda leaf: leaf[order], sourced(240)))
    for one, other in zip(jax.tree.leaves(again.joint), jax.tree.leaves(found.joint), strict=True):
        np.testing.assert_array_equal(one, other)


def test_each_restart_sees_a_sample_of_its_own():
    """Of about the given size, spread over both clouds, so that every restart finds what is new."""
    seen = []
    sampled = fits(240, 6, 12, max_points=150, progress=lambda: seen.append(1))
    assert len(seen) == 2
    assert sampled.message_length[0] != sampled.message_length[1]
    assert all(excess[2] > 0.9 for excess in both(point_excess, sampled, CENTRES, True))


def test_the_subsamples_of_the_restarts_follow_each_other_in_one_sequence():
    """Each can be drawn alone, and they differ."""
    points, random = sourced(240), np.random.default_rng([0, 7])
    drawn = []
    for restart in range(3):
        priority = random.random(240)
        chosen = subsample(points, 60, [0, 7], restart).points.points
        rows = np.flatnonzero((points.points.points[:, None] == chosen[None]).all(axis=2).any(axis=1))
        drawn.append(rows)
        # Where a stretch is of the points of one cloud, the point of the least priority is chosen.
        assert 50 <= len(rows) <= 60 and priority[rows].mean() < 0.3
    assert not np.array_equal(drawn[0], drawn[1]) and not np.array_equal(drawn[1], drawn[2])


@pytest.mark.parametrize("max_points", [6000, 150])
def test_a_restart_is_the_same_whatever_others_are_computed(max_points):
    """Starts and subsamples, to the last digit: a later run goes on from an earlier one."""
    few, more = (arrays(240, 6, 12, restarts=own, max_points=max_points) for own in (range(2), range(2, 4)))
    at_once = arrays(240, 6, 12, restarts=range(4), max_points=max_points)
    assert len({*at_once["message_length"].tolist()}) > 1
    for name, whole in at_once.items():
        np.testing.assert_array_equal(np.concatenate([few[name], more[name]]), whole)


def test_without_a_finite_fit_there_is_an_error():
    with pytest.raises(ComputationError, match="none of 2 restarts gave a joint mixture; raise noise_floor"):
        fits(240, 6, 12, prior=joint_prior(np.nan, 0.0))
