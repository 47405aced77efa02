import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.changes import MatchFacts
from gmmjax.learning.moved_scenes import SceneSettings, found_scene
from gmmjax.learning.same_object import (
    SIGNS,
    Example,
    examples_of,
    examples_of_scene,
    learned,
    left_out_log_odds,
    summary,
)

# A seed of a scene that stays as it was.
NOTHING_MOVED = 1
# Surveys of few points, whose changes are found in a second.
SMALL = SceneSettings(frames=(8, 9), pixels=(30_000, 30_001), voxel=(0.016, 0.0161))


@pytest.fixture(scope="module")
def made_up():
    """Examples in which only the covered and the contradicted fractions tell, the latter the wrong way round."""
    random = np.random.default_rng(0)
    examples = []
    for scene in range(600):
        facts = random.uniform(size=len(MatchFacts._fields))
        truth = random.random() < 1 / (1 + np.exp(-8 * (facts[0] - 0.5) - 4 * (facts[2] - 0.5)))
        situation, kind = ("standing", "free", "in place")[scene % 3], ("one", "another")[scene % 2]
        examples.append(Example(situation, MatchFacts(*facts), bool(truth), kind))
    return examples


def test_what_tells_is_learned_and_no_weight_has_the_wrong_sign(made_up):
    model = learned(made_up)
    for own in model.values():
        assert own.weights[0] == own.weights.max() > 1
        assert (own.weights * np.array(SIGNS) >= 0).all()
        assert own.weights[MatchFacts._fields.index("contradicted")] == 0


def test_two_objects_that_weigh_more_are_thought_more_frequent(made_up):
    usual, more = (learned(made_up, others) for others in (1.0, 4.0))
    assert more["free"].intercept < usual["free"].intercept - 0.5
    assert more["in place"].intercept == usual["in place"].intercept


def test_the_summary_counts_what_is_recognised_by_what_other_scenes_teach(made_up):
    log_odds = left_out_log_odds(made_up, 1.0)
    strict, usual = (list(summary(made_up, log_odds, threshold)) for threshold in (0.9, 0.5))
    assert usual[2].startswith("| standing | 200 | ")
    recognised, wrong = (
        [[int(cell) for cell in line.split("|")[column].split()] for line in usual[2:]] for column in (4, 5)
    )
    assert np.sum(recognised) > 2 * np.sum(wrong) > 0
    assert int(strict[2].split("|")[4]) < recognised[0][0]


def test_learning_from_too_few_scenes_is_refused(made_up):
    with pytest.raises(InputError, match="'free'; learn from more scenes"):
        learned([example for example in made_up if example.situation != "free"])


@pytest.fixture(scope="module")
def shifted():
    """A thing that was shifted in its place, among others."""
    found = found_scene("room, within a place", 6, SMALL)
    assert found is not None
    return found


@pytest.mark.slow
def test_the_truth_of_what_was_found_is_known(shifted):
    truths = [shifted.truth_of(index) for index in range(len(shifted.changes.items))]
    assert set(shifted.scene.motions) & set(truths)
    for number in shifted.scene.motions:
        moved = shifted.shape(number) @ shifted.motion(number)[:3, :3].T + shifted.motion(number)[:3, 3]
        surface, own = shifted.changes.pair.surfaces.after, shifted.scene.truth.after == number
        assert np.median(surface.tree.query(moved)[0]) < 2 * surface.nearest_distance
        assert own.sum() > 50


def test_the_motion_within_the_place_is_an_example(shifted):
    examples = list(examples_of("room, within a place", shifted))
    assert any(example.one_object and example.situation == "in place" for example in examples)


@pytest.mark.slow
def test_a_scene_gives_the_same_examples_every_time(shifted):
    kind = "room, within a place"
    assert examples_of_scene((kind, 6), SMALL) == list(examples_of(kind, shifted))


def test_a_scene_of_a_family_in_which_nothing_moved_is_passed_over(monkeypatch):
    monkeypatch.setattr("gmmjax.learning.moved_scenes.JointDetector", None)
    assert found_scene("tabletop", NOTHING_MOVED, SceneSettings()) is None
