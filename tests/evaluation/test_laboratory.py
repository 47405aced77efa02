import numpy as np
import pytest

from gmmjax.evaluation.laboratory import CONDITIONS, laboratory_pair, laboratory_sources


def test_every_condition_has_its_scenes():
    sources = laboratory_sources([4, 5], level="hard", poses="unknown")
    assert len(sources) == 2 * len(CONDITIONS) == 18
    assert {source.group for source in sources} == {"hard panorama, poses unknown"}


@pytest.mark.parametrize(("condition", "before", "after"), [("(-1 +1)", 1, 1), ("(moved)", 1, 1), ("(none)", 0, 0)])
def test_scenes_are_what_their_condition_says(condition, before, after):
    pair = laboratory_pair(condition, 1, "normal", "frame", "given")
    assert len(np.unique(pair.before.truth)) - 1 == before and len(np.unique(pair.after.truth)) - 1 == after
    assert pair.unchanged == (condition == "(none)")
    assert set(pair.before.truth) - {-1} == set(pair.after.truth) - {-1} or condition != "(moved)"
    assert pair.before.unseen is not None and pair.before.not_counted == frozenset()


def test_poses_are_given_or_not():
    given, unknown = (laboratory_pair("(+1)", 1, "normal", "frame", poses) for poses in ("given", "unknown"))
    np.testing.assert_array_equal(given.after.points, unknown.after.points)
    assert given.before.views is not None and given.after.views is not None
    assert unknown.before.views is unknown.after.views is None
