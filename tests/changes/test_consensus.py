import dataclasses
import pickle

import jax
import numpy as np
import pytest

from gmmjax import Changes, DetectionConfig, InputError, detect_changes
from gmmjax.changes import (
    DETECTORS,
    AbstractChangeDetector,
    JointDetector,
    RestartFits,
    detect_consensus,
    largest_difference,
)
from gmmjax.changes.consensus import doublings
from gmmjax.errors import ComputationError
from gmmjax.scenes import random_scene
from tests.changes.rooms import around, box, scanned

ARRAYS = tuple(f"{name}_{time}" for name in ("labels", "probability", "unobserved") for time in ("before", "after"))


def gaussians():
    scene = random_scene(jax.random.key(11), appeared=1, disappeared=1, points=250)
    return scene.before, scene.after


def room():
    """A box came and another went."""
    views, settings = around(8), {"voxel": 0.04, "noise": 0.004}
    stays, went, came = (box((*place, 0), (0.3,) * 3) for place in ((0.2, 0.3), (0.3, -0.4), (-0.4, -0.1)))
    return scanned(views, [stays, went], **settings), scanned(views, [stays, came], **settings, seed=1)


# Clouds that fill volumes, surfaces, and separate fits.
CASES = {"gaussians": (gaussians, "joint"), "room": (room, "joint"), "greedy": (gaussians, "greedy")}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """Both clouds, settings, and the consensus of four restarts."""
    make, method = CASES[request.param]
    clouds, config = make(), DetectionConfig(method=method, restarts=4, registration="never")
    return clouds, config, detect_consensus(*clouds, config=config)


@pytest.fixture(scope="module")
def two(case):
    """The consensus of the first two of them."""
    clouds, config, _ = case
    return detect_consensus(*clouds, config=dataclasses.replace(config, restarts=2))


def assert_same(changes, expected):
    """In every bit, but for the time that it took."""
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(changes, name), getattr(expected, name))
    records = [own.to_dict() for own in (changes, expected)]
    for record in records:
        del record["diagnostics"]["seconds"]
    assert records[0] == records[1]


def assert_same_fits(fits, expected):
    assert fits.method == expected.method and set(fits.arrays) == set(expected.arrays)
    for name, values in expected.arrays.items():
        np.testing.assert_array_equal(fits.arrays[name], values)


@pytest.mark.slow
def test_the_record_is_that_of_a_detection(case):
    clouds, config, four = case
    assert_same(four.changes, detect_changes(*clouds, config=config))
    assert len(four.changes) == 2 and len(four.fits) == 4
    assert four.settled is None and four.convergence == ()


@pytest.mark.slow
def test_restarts_that_are_added_are_those_that_are_computed_at_once(case, two, tmp_path):
    clouds, config, four = case
    two.fits.save(tmp_path / "fits.npz")
    told = []
    added = detect_consensus(
        *clouds,
        config=config,
        earlier=RestartFits.load(tmp_path / "fits.npz"),
        progress=lambda stage, share: told.append((stage, share)),
    )
    assert_same(added.changes, four.changes)
    assert_same_fits(added.fits, four.fits)
    assert added.standard_errors == four.standard_errors
    # Only those that were missing: of each cloud where it is fitted by itself.
    fits = sum(stage == "Fitting the mixtures" for stage, _ in told) - 1
    assert fits == (2 if config.method == "joint" else 4)


def test_of_more_fits_the_first_are_used_and_all_are_kept(case, two):
    clouds, config, four = case
    fewer = dataclasses.replace(config, restarts=2)
    told = []
    found = detect_consensus(*clouds, config=fewer, earlier=four.fits, progress=lambda stage, _: told.append(stage))
    assert_same(found.changes, two.changes)
    assert_same_fits(found.fits, four.fits)
    assert "Fitting the mixtures" not in told


@pytest.mark.slow
def test_each_change_has_a_standard_error_where_there_are_restarts_to_compare(case):
    clouds, config, four = case
    assert len(four.standard_errors) == len(four.changes) == 2
    assert all(0 <= error < 0.5 for error in four.standard_errors)
    alone = detect_consensus(*clouds, config=dataclasses.replace(config, restarts=1), earlier=four.fits)
    assert set(alone.standard_errors) == {None} and len(alone.standard_errors) == len(alone.changes)


@pytest.mark.slow
def test_the_restarts_end_when_the_probabilities_have_settled(case):
    clouds, config, four = case
    more, told = dataclasses.replace(config, restarts=64), []
    found = detect_consensus(*clouds, config=more, until_stable=1.0, progress=lambda _, share: told.append(share))
    assert found.settled and [step.restarts for step in found.convergence] == [4]
    assert found.convergence[0].difference < 1
    assert_same(found.changes, four.changes)
    assert_same_fits(found.fits, four.fits)
    assert told == sorted(told) and told[-1] == 1


@pytest.mark.slow
def test_probabilities_that_never_settle_take_all_restarts():
    clouds, config = gaussians(), DetectionConfig(restarts=6)
    found = detect_consensus(*clouds, config=config, until_stable=1e-300)
    assert found.settled is False and [step.restarts for step in found.convergence] == [4, 6]
    assert_same(found.changes, detect_changes(*clouds, config=config))


@pytest.mark.slow
def test_fits_without_a_mixture_are_waited_out():
    """Nothing is found with the first two; they are kept, and left out of the average."""
    clouds, config = gaussians(), DetectionConfig(restarts=8)
    fits = detect_consensus(*clouds, config=config).fits
    failed = np.where(np.arange(8) < 2, 2, fits.arrays["result"])
    earlier = RestartFits("joint", {**fits.arrays, "result": failed.astype(np.int32)})
    found = detect_consensus(*clouds, config=config, earlier=earlier, until_stable=1e-300)
    assert [step.restarts for step in found.convergence] == [8]
    assert len(found.fits) == 8 and len(found.changes.diagnostics["steps"]) == 6
    with pytest.raises(ComputationError, match="none of 2 restarts gave a joint mixture"):
        detect_consensus(*clouds, config=DetectionConfig(restarts=2), earlier=earlier)


def test_fits_of_something_else_are_refused(case):
    clouds, config, four = case
    other = "transport" if config.method == "joint" else "joint"
    with pytest.raises(
        InputError, match=rf"earlier: these are no fits of method {other} \(they are marked as of {config.method}\)"
    ):
        detect_consensus(*clouds, config=dataclasses.replace(config, method=other), earlier=four.fits)
    mislabelled = RestartFits(other, four.fits.arrays)
    with pytest.raises(InputError, match=f"earlier: these are no fits of method {other}"):
        detect_consensus(*clouds, config=dataclasses.replace(config, method=other), earlier=mislabelled)
    with pytest.raises(InputError, match=r"mixtures of \d+ slots, not 60, so they are of other clouds or settings"):
        detect_consensus(*clouds, config=dataclasses.replace(config, max_components=60), earlier=four.fits)


@pytest.mark.usefixtures("as_users")
@pytest.mark.parametrize("tolerance", [0, -0.1, float("nan"), 1.5, True, "0.1"])
def test_a_tolerance_is_a_probability(tolerance):
    with pytest.raises(InputError, match=r"until_stable=.* must be a probability above 0"):
        detect_consensus(np.zeros((20, 3)), np.zeros((20, 3)), until_stable=tolerance)


def test_a_method_without_restarts_has_no_consensus(monkeypatch):
    class Restless(AbstractChangeDetector):
        def changes(self, scans, report=None):
            raise AssertionError

    monkeypatch.setattr("gmmjax.changes.detect.DETECTORS", {**DETECTORS, "joint": Restless})
    with pytest.raises(InputError, match="method=joint has no restarts"):
        detect_consensus(np.zeros((20, 3)), np.zeros((20, 3)))


def test_a_consensus_can_be_sent_to_another_process(case):
    _, _, four = case
    again = pickle.loads(pickle.dumps(four))
    assert_same(again.changes, four.changes)
    assert_same_fits(again.fits, four.fits)
    assert again.standard_errors == four.standard_errors


def test_what_does_not_depend_on_the_fits_is_computed_once(monkeypatch):
    calls = []
    compute = JointDetector.prepared
    monkeypatch.setattr(JointDetector, "prepared", lambda *arguments: calls.append(1) or compute(*arguments))
    detect_consensus(*gaussians(), config=DetectionConfig(restarts=4), until_stable=1e-300)
    assert calls == [1]


@pytest.mark.parametrize(
    ("most", "numbers"), [(1, [1]), (2, [2]), (3, [2, 3]), (8, [2, 4, 8]), (100, [2, 4, 8, 16, 32, 64, 100])]
)
def test_restarts_double_up_to_the_last(most, numbers):
    assert list(doublings(most)) == numbers


def record(labels, probability):
    """With two points in the before cloud, and the others in the after cloud."""
    labels, probability = np.array(labels), np.array(probability, float)
    values = {
        f"{name}_{time}": own[part]
        for name, own in (("labels", labels), ("probability", probability), ("unobserved", labels < -1))
        for time, part in (("before", slice(2)), ("after", slice(2, None)))
    }
    return Changes(**values, items=(), emd=0.0, config=DetectionConfig(), diagnostics={})


EARLIER = record([-1, 0, 0, -1, -1], [0.1, 0.9, 0.7, 0.4, 0.0])


@pytest.mark.parametrize(
    ("labels", "probability", "expected"),
    [
        # The same; a change that is as probable on average, but not point by point; one that spans both clouds.
        ([-1, 0, 0, -1, -1], [0.1, 0.9, 0.7, 0.4, 0.0], 0.0),
        ([-1, 0, 0, -1, -1], [0.1, 0.7, 0.9, 0.4, 0.0], 0.2),
        ([-1, 0, 0, -1, -1], [0.1, 0.9, 0.3, 0.4, 0.0], 0.2),
        # Of points that are of no change nothing is asked; a change that is gone counts, as does a new one.
        ([-1, 0, 0, -1, -1], [0.4, 0.9, 0.7, 0.1, 0.3], 0.0),
        ([-1, -1, -1, -1, -1], [0.1, 0.4, 0.4, 0.4, 0.0], 0.4),
        ([-1, 1, 1, 0, 0], [0.1, 0.9, 0.7, 0.6, 0.5], 0.35),
    ],
)
def test_the_largest_difference_is_that_of_the_points_of_a_change(labels, probability, expected):
    later = record(labels, probability)
    assert largest_difference(EARLIER, later) == pytest.approx(expected, abs=1e-12)
    assert largest_difference(later, EARLIER) == pytest.approx(expected, abs=1e-12)


def test_two_records_without_changes_do_not_differ():
    nothing = record([-1] * 5, [0.3] * 5)
    assert largest_difference(nothing, record([-1] * 5, [0.1] * 5)) == 0
