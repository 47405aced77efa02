import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.thesis.laboratory import THINGS, laboratory_of
from gmmjax.thesis.laboratory.runs import RUNS, object_changes

# Figure 3.6 of the thesis.
OBJECTS = {
    "run1": {"robot", "cargo bag"},
    "run2": {"robot", "cargo bag"},
    "run3": {"robot", "cargo bag"},
    "run4": {"robot", "cargo bag", "gear box"},
    "run5": set(),
}


def corners(solid):
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    return solid.centre + (signs * solid.extent / 2) @ solid.rotation.T


@pytest.mark.parametrize("run", list(OBJECTS))
def test_the_runs_of_the_figure_have_their_objects(run):
    surveyed = laboratory_of(run, 0)
    assert set(surveyed.objects) == OBJECTS[run]
    assert set(surveyed.things) - set(surveyed.objects) == set(laboratory_of("run5", 0).things)


@pytest.mark.parametrize("run", RUNS)
def test_a_thing_has_the_same_label_in_every_run(run):
    for name, parts in laboratory_of(run, 3).things.items():
        assert {solid.label for solid in parts} == {THINGS.index(name)}


@pytest.mark.parametrize("run", RUNS)
@pytest.mark.parametrize("seed", range(4))
def test_objects_are_in_the_room_and_in_nothing_else(run, seed):
    surveyed = laboratory_of(run, seed)
    for name in surveyed.objects:
        others = [solid for other, parts in surveyed.things.items() if other != name for solid in parts]
        for part in surveyed.things[name]:
            places = np.concatenate([corners(part), part.centre[None]])
            assert (np.abs(places[:, :2]) < 1.1 + 1e-9).all() and (places[:, 2] > -1e-9).all()
            assert not any(solid.contains(places, -1e-6).any() for solid in others)


def test_the_run_with_most_objects_differs_from_the_empty_one_by_them():
    empty, full = laboratory_of("run5", 1), laboratory_of("run4", 1)
    assert object_changes(empty, full) == dict.fromkeys(OBJECTS["run4"], "appeared")
    assert object_changes(full, empty) == dict.fromkeys(OBJECTS["run4"], "disappeared")
    assert object_changes(full, full) == {}
    # The robot stays where it is docked.
    assert object_changes(laboratory_of("run3", 1), full) == {"cargo bag": "moved", "gear box": "appeared"}


def test_every_seed_is_another_laboratory():
    poses = [laboratory_of("run1", seed).objects["robot"] for seed in (0, 0, 1)]
    np.testing.assert_array_equal(poses[0], poses[1])
    assert 0 < np.linalg.norm(poses[0][:3, 3] - poses[2][:3, 3]) < 0.15


def test_an_unknown_run_is_named(as_users):
    with pytest.raises(InputError, match=r"run='run6' is unknown; choose from run1, "):
        laboratory_of("run6", 0)
