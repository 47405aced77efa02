import contextlib
import dataclasses
import importlib
import io
import json
import tomllib

import jax
import numpy as np
import optax
import pytest

from gmmjax import DetectionConfig, InputError, InputWarning
from gmmjax.cli import main
from gmmjax.clouds import write_ply
from gmmjax.reporting.tuning_files import write_state
from gmmjax.tuning import TuningSettings, TuningState, tune
from gmmjax.tuning.pair_loss import pair_loss, pair_loss_alone, total_gradient, total_loss
from gmmjax.tuning.parameters import free_of
from gmmjax.tuning.scan_pairs import ready_pair
from gmmjax.tuning.search import Search
from gmmjax.tuning.split_pairs import _split, split_pairs
from tests.differences import assert_derivatives, difference_gradient
from tests.tuning.scenes import SETTINGS, gaussian_pair

QUICK = ["--steps", "2", "--starts", "1", "--pairs-per-step", "2", "--max-points", str(SETTINGS.max_points)]
WRONG = DetectionConfig(noise_floor=0.003, tolerance=0.6, restarts=2)
NAMES = ("noise_floor", "tolerance")

pytestmark = pytest.mark.usefixtures("no_compilation_cache")


@pytest.fixture(scope="module")
def pairs():
    return [gaussian_pair(seed, changed=seed != 2) for seed in range(4)]


@pytest.fixture(scope="module")
def course(pairs):
    """A tuning from wrong settings: its result and the states on the way."""
    states = []
    result = tune(pairs, config=WRONG, settings=SETTINGS, checkpoint=states.append)
    return result, states


@pytest.fixture
def steps_alone(monkeypatch):
    """For tests of the course: the settings are not centred, and `detect_changes` does not judge them."""

    def as_they_are(self, values):
        return values, self._judged(free_of(self.names, values)[None], self.names)[0]

    monkeypatch.setattr(Search, "centred", as_they_are)
    monkeypatch.setattr(
        importlib.import_module("gmmjax.tuning.tuner"), "_judged_by_detection", lambda result, *_: result
    )


@pytest.mark.slow
def test_wrong_settings_get_better(course):
    result, _ = course
    assert result.improved and result.loss == "f1"
    assert result.best[0] < 0.8 * result.baseline[0]
    assert result.tuned["tolerance"] < 0.4
    assert result.config == dataclasses.replace(WRONG, **result.tuned)


def test_the_config_is_in_the_middle_of_those_as_good_as_the_least_loss(course):
    result, _ = course
    losses = result.state.losses[..., 0]
    assert np.nanmin(losses) == losses[result.best_step, result.best_start]
    assert result.best[0] < 1.15 * np.nanmin(losses)
    factors = result.state.values[result.best_step, result.best_start] / list(result.tuned.values())
    assert (np.abs(np.log2(factors)) <= 1.5).all()


def test_settings_beside_an_edge_are_moved_away_from_it(pairs):
    search = Search(
        split_pairs(pairs, WRONG, SETTINGS, lambda stage, share: None), NAMES, "f1", SETTINGS, optax.sgd(0.1)
    )
    # As good from an eighth up to just above the tolerance; for the noise floor, anywhere.
    search._judged = lambda free, names: np.where(free[:, 1:] > np.log(0.25), 0.9, 0.5) * np.ones((1, 3))
    values, losses = search.centred(np.array([0.01, 0.24]))
    assert values == pytest.approx([0.01, 0.24 / 2**1.5]) and losses[0] == 0.5


@pytest.mark.slow
def test_an_interrupted_tuning_goes_on_where_it_was(course, pairs, steps_alone):
    result, states = course
    again = tune(pairs, config=WRONG, settings=SETTINGS, resume=states[1])
    np.testing.assert_allclose(again.state.losses, result.state.losses, rtol=1e-9)
    np.testing.assert_allclose(again.state.values, result.state.values, rtol=1e-9)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_course(course, pairs, steps_alone):
    result, states = course
    assert [state.steps for state in states] == list(range(result.state.steps + 1))
    again = tune(pairs, config=WRONG, settings=dataclasses.replace(SETTINGS, steps=1))
    np.testing.assert_allclose(again.state.losses, result.state.losses[:2], rtol=1e-9)


def test_the_result_is_plain_values_too(course):
    result, _ = course
    stopped = dataclasses.replace(result, state=result.state._replace(losses=np.full((1, 2, 3), np.nan)))
    told = json.loads(json.dumps(stopped.to_dict(), allow_nan=False))
    assert told["tuned"] == result.tuned and told["losses_after"]["all"] == result.best[0]
    assert told["course"]["losses"] == [[[None] * 3] * 2]
    np.testing.assert_array_equal(told["course"]["values"], result.state.values)


def test_pairs_are_held_back(course, pairs):
    result, _ = course
    assert sorted(result.training + result.held_back) == [pair.name for pair in pairs]
    assert len(result.held_back) == 2


@pytest.mark.slow
def test_an_optimiser_of_ones_own(course, pairs, steps_alone):
    still = tune(pairs, config=WRONG, settings=dataclasses.replace(SETTINGS, steps=1), optimiser=optax.sgd(0.0))
    np.testing.assert_array_equal(still.state.values[0], still.state.values[1])
    np.testing.assert_allclose(still.state.losses[0], course[0].state.losses[0], rtol=1e-9)


@pytest.mark.slow
def test_settings_that_gain_nothing_stay(pairs, course):
    tuned = course[0].config
    result = tune(pairs, config=tuned, settings=dataclasses.replace(SETTINGS, steps=1), optimiser=optax.sgd(0.0))
    # The other starts are worse, and the first does not move.
    assert not result.improved and result.config == tuned


def test_the_gradient_is_that_of_the_loss(pairs):
    ready = [ready_pair(pair, WRONG, SETTINGS.max_points, seed=0) for pair in pairs[:2]]
    key = jax.random.key(0)

    def loss(free):
        return total_loss(np.array([pair_loss_alone(free, pair, key, NAMES, "f1").sums for pair in ready]), "f1")

    with jax.enable_x64(True):
        free = np.log([0.05, 0.2])
        parts = [pair_loss(free, pair, key, NAMES, "f1") for pair in ready]
        gradient = total_gradient(
            np.array([part.sums for part in parts]), np.array([part.gradients for part in parts]), "f1"
        )
        assert_derivatives(gradient, difference_gradient(loss, free, step=3e-4))


@pytest.mark.slow
def test_without_truth_held_out_points_are_the_judge():
    pairs = [gaussian_pair(seed, labelled=False) for seed in range(3)]
    result = tune(pairs, config=WRONG, settings=dataclasses.replace(SETTINGS, steps=2, starts=1))
    assert result.loss == "likelihood" and result.improved
    assert result.tuned["tolerance"] < WRONG.tolerance


def test_two_pairs_are_few(pairs, steps_alone):
    with pytest.warns(InputWarning, match="too few"):
        result = tune(pairs[:2], config=WRONG, settings=dataclasses.replace(SETTINGS, steps=1))
    assert result.training == result.held_back


def test_pairs_with_and_without_changes_are_split_alike():
    training, validation = _split([True] * 6 + [False] * 4, TuningSettings(validation_share=0.5))
    assert len(training) == len(validation) == 5 and not set(training) & set(validation)
    assert sum(number >= 6 for number in validation) == 2


def test_truth_that_does_not_fit_is_named(pairs):
    wrong = dataclasses.replace(pairs[1], truth_after=pairs[1].truth_after[:-1])
    with pytest.raises(InputError, match=r"seed 1: truth_after .* for each of the 500 points"):
        tune([pairs[0], wrong], settings=SETTINGS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": 0}, "steps=0"),
        ({"learning_rate": -1.0}, "learning_rate"),
        ({"validation_share": 1.0}, "validation_share"),
        ({"max_points": 99}, "max_points"),
    ],
)
def test_settings_out_of_their_range_are_named(change, message):
    with pytest.raises(InputError, match=message):
        TuningSettings(**change)


def test_pairs_must_all_have_truth_or_none(pairs):
    with pytest.raises(InputError, match="pairs is empty"):
        tune([])
    mixed = [pairs[0], gaussian_pair(1, labelled=False)]
    with pytest.raises(InputError, match=r"pairs seed 1: have no truth"):
        tune(mixed)
    with pytest.raises(InputError, match="loss='likelihood'"):
        tune(mixed, settings=TuningSettings(loss="brier"))


def test_a_loss_that_is_not_finite_at_the_start_is_an_error(pairs, monkeypatch):
    monkeypatch.setattr(Search, "_judged", lambda self, free, names: np.full((len(free), 3), np.nan))
    with pytest.raises(InputError, match="the loss is nan at the start, on the pairs seed"):
        tune(pairs, config=WRONG, settings=SETTINGS)


@pytest.mark.slow
def test_it_ends_with_the_last_good_settings_where_no_pair_has_a_gradient(pairs, course, monkeypatch, steps_alone):
    gradients = Search._gradients
    monkeypatch.setattr(
        Search, "_gradients", lambda self, free, step: gradients(self, free, step) * (np.nan if step == 1 else 1.0)
    )
    states = []
    result = tune(pairs, config=WRONG, settings=SETTINGS, checkpoint=states.append)
    assert result.stopped == "not finite" and result.state.steps == 1
    assert np.isfinite(list(result.tuned.values())).all()
    np.testing.assert_array_equal(states[-1].losses, result.state.losses)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three pairs with truth, and the settings of a wrong sensor."""
    folder = tmp_path_factory.mktemp("tuning")
    for seed in range(3):
        own = folder / "pairs" / f"scene{seed}"
        own.mkdir(parents=True)
        pair = gaussian_pair(seed)
        for side in ("before", "after"):
            write_ply(own / f"{side}.ply", getattr(pair, side))
            np.save(own / f"truth_{side}.npy", getattr(pair, f"truth_{side}"))
    (folder / "wrong.toml").write_text("noise_floor = 0.003\ntolerance = 0.6\nrestarts = 2\n")
    return folder


def run_tune(folder, out, *more):
    return main(
        ["tune", str(folder / "pairs"), "--out", str(out), "--config", str(folder / "wrong.toml"), *QUICK, *more]
    )


@pytest.fixture(scope="module")
def run(folder):
    """The config that the command writes, and what it prints."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert run_tune(folder, folder / "tuned.toml") == 0
    return folder / "tuned.toml", printed.getvalue()


@pytest.fixture(scope="module")
def tuned(run):
    return run[0]


@pytest.mark.slow
def test_writes_a_config_that_detect_takes(folder, tuned, capsys):
    config = DetectionConfig.from_dict(tomllib.loads(tuned.read_text()))
    assert config.tolerance < 0.6 and config.restarts == 2
    pair = folder / "pairs" / "scene0"
    clouds = [str(pair / "before.ply"), str(pair / "after.ply")]
    assert main(["detect", *clouds, "--out", str(folder / "result"), "--config", str(tuned), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["config"]["tolerance"] == config.tolerance


def test_leaves_the_course_and_no_state(tuned):
    assert sorted(path.name for path in tuned.parent.glob("tuned*")) == ["tuned.png", "tuned.toml"]


def test_says_what_was_gained(run):
    _, out = run
    for words in ("tolerance", "held back", "segment F1 of detect", "--config"):
        assert words in out


@pytest.mark.slow
def test_goes_on_after_an_interruption(folder, tuned, tmp_path, monkeypatch, capsys):
    out, state = tmp_path / "later.toml", tmp_path / "later.progress.npz"
    step = Search.step

    def interrupted(self, own):
        if own.steps == 1:
            raise KeyboardInterrupt
        return step(self, own)

    with monkeypatch.context() as patch:
        patch.setattr(Search, "step", interrupted)
        assert run_tune(folder, out) == 130
    assert state.is_file() and not out.exists()
    capsys.readouterr()
    assert run_tune(folder, out) == 0
    assert "Going on after step 1" in capsys.readouterr().err
    assert out.read_text() == tuned.read_text() and not state.exists()


def test_a_state_of_other_settings_is_not_taken_up(folder, tmp_path, capsys):
    one = np.zeros((1, 1, 1))
    write_state(tmp_path / "other.progress.npz", TuningState(one[0], (), one[0, 0] > 0, one, one, one[0, 0]), "other")
    assert run_tune(folder, tmp_path / "other.toml") == 2
    assert "--restart" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--out", "tuned.txt"], "must end in .toml"),
        (["--out", "missing/tuned.toml"], "there is no folder missing"),
        (["--steps", "0"], "--steps 0"),
        (["--parameters", "covariance_scale"], "go together"),
        (["--validation-share", "2"], "--validation-share 2"),
    ],
)
def test_bad_usage_is_named(folder, tmp_path, capsys, more, message):
    assert run_tune(folder, tmp_path / "bad.toml", *more) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_files_that_are_there_are_kept(folder, tuned, capsys):
    before = tuned.read_text()
    assert run_tune(folder, tuned) == 2
    assert "--overwrite" in capsys.readouterr().err and tuned.read_text() == before
