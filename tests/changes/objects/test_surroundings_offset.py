import numpy as np
import pytest

from gmmjax.changes.objects.surroundings_offset import OffsetSettings, surroundings_offset, without_spikes

SHAPE, OFFSET, NOISE = (60, 60), 0.02, 0.004
EVERYWHERE, AREA = np.ones(SHAPE, bool), 100


def difference(seed=0):
    return OFFSET + NOISE * np.random.default_rng(seed).normal(size=SHAPE)


def test_the_offset_is_within_its_error():
    errors = []
    for seed in range(40):
        found = surroundings_offset(difference(seed), EVERYWHERE, AREA, 0.01)
        errors.append((found.value - OFFSET) / found.error)
    assert 0.6 < np.std(errors) < 1.5
    assert found.error == pytest.approx(NOISE / np.sqrt(EVERYWHERE.sum()), rel=0.4)


def test_changes_beside_the_change_do_not_distort_it():
    beside = difference()
    beside[:20, :20] += 0.5
    assert surroundings_offset(beside, EVERYWHERE, AREA, 0.01).value == pytest.approx(OFFSET, abs=0.001)
    distorted = surroundings_offset(beside, EVERYWHERE, AREA, 0.01, OffsetSettings(outlying=np.inf))
    assert distorted.value > 1.1 * OFFSET


def test_what_differs_from_block_to_block_makes_it_uncertain():
    waves = difference() + 0.01 * np.sin(np.arange(SHAPE[1]) / 8)
    even, uneven = (surroundings_offset(own, EVERYWHERE, AREA, 0.01) for own in (difference(), waves))
    assert uneven.error > 3 * even.error and uneven.density > 9 * even.density


def test_without_surroundings_the_registration_error_is_that_of_the_pair():
    few = np.zeros(SHAPE, bool)
    few[0, :3] = True
    nowhere = np.full(SHAPE, np.nan)
    for found in (surroundings_offset(difference(), few, AREA, 0.01), surroundings_offset(nowhere, few, AREA, 0.01)):
        assert found == (0.0, 0.01, 0.0, np.inf)


def test_an_exact_registration_has_no_offset():
    assert surroundings_offset(difference(), EVERYWHERE, AREA, 0.0).value == 0


def test_single_points_off_the_surface_are_taken_off_but_not_those_of_the_change():
    spiky, core = difference(), np.zeros(SHAPE, bool)
    spiky[10, 10], spiky[40, 40], core[40, 40] = 0.3, 0.3, True
    found = without_spikes(spiky, core, ~core)
    assert found[10, 10] == pytest.approx(OFFSET, abs=3 * NOISE) and found[40, 40] == 0.3
    np.testing.assert_array_equal(without_spikes(spiky, core, np.zeros(SHAPE, bool)), spiky)
