import numpy as np
import pytest

from gmmjax.changes import MatchFacts
from gmmjax.learning.same_object import SIGNS, Example, LearningSettings, examples_of, learned, summary


@pytest.fixture(scope="module")
def made_up():
    """Examples in which only the covered and the contradicted fractions tell, the latter the wrong way round."""
    random = np.random.default_rng(0)
    examples = []
    for scene in range(600):
        facts = random.uniform(size=len(MatchFacts._fields))
        truth = random.random() < 1 / (1 + np.exp(-8 * (facts[0] - 0.5) - 4 * (facts[3] - 0.5)))
        examples.append(Example(("standing", "free", "in place")[scene % 3], MatchFacts(*facts), bool(truth), scene))
    return examples


def test_what_tells_is_learned_and_no_weight_has_the_wrong_sign(made_up):
    model = learned(made_up, LearningSettings())
    for own in model.situations.values():
        assert own.weights[0] == own.weights.max() > 1
        assert (own.weights * np.array(SIGNS) >= 0).all()
        assert own.weights[MatchFacts._fields.index("contradicted")] == 0


def test_the_summary_counts_what_is_recognised(made_up):
    lines = list(summary(made_up, learned(made_up, LearningSettings())))
    assert lines[0].startswith("standing: 200 matches")
    assert len(lines) == 3


def test_the_examples_of_a_scene_are_the_same_every_time():
    settings = LearningSettings(pixels=(48, 48))
    first, again = (list(examples_of(1, "floor", "shifted", settings)) for _ in range(2))
    assert first == again
    assert any(example.one_object and example.situation == "in place" for example in first)
