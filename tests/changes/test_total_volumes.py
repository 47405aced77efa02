import dataclasses

import numpy as np
import pytest

from gmmjax.changes import Change, Changes, volume_totals
from tests.reporting.conftest import change
from tests.reporting.conftest import pair as pair


def measured(volume, error, common, gain_or_loss):
    points = np.random.default_rng(0).normal(size=(20, 3))
    own = {"volume_error": error, "volume_registration_error": common, "gain_or_loss": gain_or_loss}
    return dataclasses.replace(change("appeared", points), volume=volume, **own)


def test_registration_errors_add_up_and_the_others_do_not():
    independent = [measured(10.0, 3.0, 0.0, "gain"), measured(20.0, 4.0, 0.0, "gain")]
    assert volume_totals(independent).gained_error == pytest.approx(5.0)
    common = [measured(10.0, 3.0, 3.0, "gain"), measured(20.0, 4.0, 4.0, "loss")]
    totals = volume_totals(common)
    assert totals.net_error == pytest.approx(7.0)
    assert (totals.gained, totals.lost, totals.net) == (10.0, 20.0, -10.0)
    assert (totals.gained_error, totals.lost_error) == (3.0, 4.0)


def test_a_sum_with_a_volume_that_has_no_interval_has_none():
    totals = volume_totals([measured(10.0, None, None, "gain"), measured(20.0, 4.0, 0.0, "loss")])
    assert (totals.gained, totals.gained_error, totals.lost_error, totals.net_error) == (10.0, None, 4.0, None)


def test_a_volume_that_is_counted_in_another_change_is_counted_once():
    other = dataclasses.replace(measured(None, None, None, None), volume_counted_in=0)
    assert volume_totals([measured(10.0, 3.0, 1.0, "loss"), other]).lost == 10.0


def test_a_volume_without_a_sign_is_in_no_sum_of_those_with_one():
    totals = volume_totals([measured(10.0, 3.0, 1.0, None), measured(1.0, 0.5, 0.0, "gain")])
    assert (totals.gained, totals.gained_error, totals.lost, totals.net) == (1.0, 0.5, 0.0, 1.0)
    assert (totals.unsigned, totals.unsigned_error) == (10.0, 3.0)


def test_a_change_that_is_a_gain_in_one_part_and_a_loss_in_another_counts_for_both():
    both = dataclasses.replace(
        measured(10.0, 3.0, 1.0, "loss"),
        opposite_volume=4.0,
        opposite_volume_error=2.0,
        opposite_volume_registration_error=1.0,
    )
    totals = volume_totals([both, measured(1.0, 0.0, 0.0, "gain")])
    assert (totals.gained, totals.lost, totals.net) == (5.0, 10.0, -5.0)
    assert (totals.gained_error, totals.lost_error) == (2.0, 3.0)
    assert totals.net_error == pytest.approx(np.sqrt(9 - 1 + 4 - 1 + 2**2))
    assert Change.from_dict(both.to_dict()).opposite_volume_registration_error == 1.0


def test_the_record_keeps_measures_and_totals(pair, tmp_path):
    record = dataclasses.replace(pair[2], items=(measured(10.0, 3.0, 1.0, "loss"), *pair[2].items[1:]))
    assert record.to_dict()["volumes"]["lost"] == 10.0
    assert pair[2].to_dict()["volumes"] is None and pair[2].volume_totals() is None
    assert Changes.load(record.save(tmp_path)).volume_totals() == record.volume_totals()
