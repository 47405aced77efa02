import dataclasses
import tomllib

import numpy as np
import pytest

from gmmjax import DetectionConfig, InputError
from gmmjax.reporting import console
from gmmjax.reporting.tuning_files import progress_file, read_state, write_state, write_tuned
from gmmjax.tuning import TuningResult, TuningState


@pytest.fixture
def state():
    random = np.random.default_rng(0)
    losses = random.uniform(size=(4, 2, 3))
    # The second start had stopped before the last step.
    losses[3, 1] = np.nan
    return TuningState(
        free=random.normal(size=(2, 1)),
        optimiser=tuple(random.normal(size=(2, size)) for size in range(1, 13)),
        racing=np.array([True, False]),
        values=np.exp(random.normal(size=(4, 2, 1))),
        losses=losses,
        baseline=np.full(3, 0.9),
    )


@pytest.fixture
def result(state):
    return TuningResult(
        config=DetectionConfig(tolerance=0.02, restarts=3),
        improved=True,
        loss="f1",
        parameters=("tolerance",),
        tuned={"tolerance": 0.02},
        baseline=(0.9, 0.9, 0.9),
        best=(0.1, 0.1, 0.2),
        best_step=2,
        best_start=0,
        stopped="steps",
        training=("kitchen", "hall"),
        held_back=("attic",),
        state=state,
    )


def test_the_settings_are_a_config_file(result, tmp_path):
    write_tuned(tmp_path / "tuned.toml", result)
    text = (tmp_path / "tuned.toml").read_text()
    assert DetectionConfig.from_dict(tomllib.loads(text)) == result.config
    assert "kitchen, hall" in text and "attic" in text


@pytest.mark.parametrize(("improved", "heading"), [(True, "Tuned"), (False, "Tried")])
def test_the_table_does_not_call_best_what_may_be_worse(result, tmp_path, capsys, improved, heading):
    console.print_tuning(dataclasses.replace(result, improved=improved), tmp_path / "a.toml", tmp_path / "a.png")
    headings = next(line for line in capsys.readouterr().out.splitlines() if "Start" in line)
    assert headings.split() == ["Start", heading]


def test_a_course_that_gained_nothing_says_so(result, tmp_path):
    same = dataclasses.replace(result, improved=False)
    write_tuned(tmp_path / "tuned.toml", same)
    assert "left as they were" in (tmp_path / "tuned.toml").read_text()


def test_the_state_comes_back_as_it_was(state, tmp_path):
    path = progress_file(tmp_path / "tuned.toml")
    write_state(path, state, "these pairs")
    back = read_state(path, "these pairs")
    assert back.steps == 3
    for own, other in zip(
        [*back[:1], *back.optimiser, *back[2:]], [*state[:1], *state.optimiser, *state[2:]], strict=True
    ):
        np.testing.assert_array_equal(own, other)


def test_a_state_of_something_else_is_not_taken(state, tmp_path):
    write_state(tmp_path / "state.npz", state, "these pairs")
    with pytest.raises(InputError, match=r"state.npz: is of a tuning with other pairs or settings; .*--restart"):
        read_state(tmp_path / "state.npz", "other pairs")


@pytest.mark.parametrize("keep", [0, 10, 400])
def test_a_damaged_state_is_named(state, tmp_path, keep):
    path = tmp_path / "state.npz"
    write_state(path, state, "these pairs")
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InputError, match=r"state.npz: is (empty|no NPZ file)"):
        read_state(path, "these pairs")


@pytest.mark.parametrize("name", ["free", "racing", "values", "losses", "baseline"])
def test_a_state_whose_arrays_do_not_fit_is_refused(state, tmp_path, name):
    wrong = state._replace(**{name: getattr(state, name)[1:]})
    write_state(tmp_path / "state.npz", wrong, "these pairs")
    with pytest.raises(InputError, match=r"state.npz: is damaged \(its arrays do not fit each other\); .*--restart"):
        read_state(tmp_path / "state.npz", "these pairs")
