import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.evaluation import GAUSSIAN_FAMILIES, gaussian_sources
from gmmjax.evaluation.gaussians import CONDITIONS


def test_the_first_conditions_are_those_of_the_thesis():
    assert [str(condition) for condition in CONDITIONS[:4]] == ["(+1) low", "(+1) medium", "(+2) low", "(+2) medium"]
    assert "(none) low" in map(str, CONDITIONS) and "(-3 +1) medium" in map(str, CONDITIONS)
    assert len(CONDITIONS) == 18


def test_every_condition_has_a_name_of_its_own():
    for conditions in GAUSSIAN_FAMILIES.values():
        assert len(set(map(str, conditions))) == len(conditions)


@pytest.mark.parametrize("family", GAUSSIAN_FAMILIES)
def test_scenes_are_what_their_condition_says(family):
    sources = gaussian_sources([7], [family])
    assert len(sources) == len(GAUSSIAN_FAMILIES[family])
    for source, condition in zip(sources, GAUSSIAN_FAMILIES[family], strict=True):
        assert (source.name, source.group, source.condition) == ("seed 7", family, str(condition))
        pair = source.load()
        assert len(pair.before.points) == 5 * condition.points
        assert len(np.unique(pair.before.truth)) - 1 == condition.disappeared
        assert len(np.unique(pair.after.truth)) - 1 == condition.appeared
        after = 5 - condition.disappeared + condition.appeared
        assert len(pair.after.points) == round(after * condition.points * condition.density)
        assert pair.unchanged == (str(condition).startswith("(none)"))


def test_the_things_of_a_cloud_are_its_gaussians():
    pair = gaussian_sources([7])[-1].load()
    for cloud in (pair.before, pair.after):
        assert cloud.things is not None
        for thing in np.unique(cloud.things):
            assert len(np.unique(cloud.truth[cloud.things == thing])) == 1


def test_a_scene_is_its_seed():
    first, again, other = (gaussian_sources([seed])[0].load() for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.after.points, again.after.points)
    assert (first.after.points != other.after.points).any()


def test_the_number_of_points_can_be_set():
    assert len(gaussian_sources([0], points=30)[0].load().before.points) == 150


def test_unknown_families_are_refused():
    with pytest.raises(InputError, match="'many' is unknown; choose from thesis, separation"):
        gaussian_sources([0], ["many"])
