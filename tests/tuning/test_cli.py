"""`gmmjax tune` as a user meets it; the tuning itself is in test_tune."""

import json
import tomllib

import numpy as np
import pytest

from gmmjax import DetectionConfig
from gmmjax.cli import main
from gmmjax.clouds import write_ply
from tests.tuning.scenes import SETTINGS, gaussian_pair

QUICK = ["--steps", "2", "--starts", "1", "--pairs-per-step", "2", "--max-points", str(SETTINGS.max_points)]


@pytest.fixture(autouse=True, scope="module")
def no_compilation_cache():
    """JAX's own variable keeps the command line from changing JAX's settings for the other tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_COMPILATION_CACHE_DIR", "")
        yield


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


def run(folder, out, *more):
    return main(
        ["tune", str(folder / "pairs"), "--out", str(out), "--config", str(folder / "wrong.toml"), *QUICK, *more]
    )


@pytest.fixture(scope="module")
def tuned(folder):
    assert run(folder, folder / "tuned.toml") == 0
    return folder / "tuned.toml"


def test_writes_a_config_that_detect_takes(folder, tuned, capsys):
    config = DetectionConfig.from_dict(tomllib.loads(tuned.read_text()))
    assert config.tolerance < 0.6 and config.restarts == 2
    pair = folder / "pairs" / "scene0"
    clouds = [str(pair / "before.ply"), str(pair / "after.ply")]
    assert main(["detect", *clouds, "--out", str(folder / "result"), "--config", str(tuned), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["config"]["tolerance"] == config.tolerance


def test_leaves_the_course_and_no_state(tuned):
    assert sorted(path.name for path in tuned.parent.glob("tuned*")) == ["tuned.html", "tuned.toml"]


def test_says_what_was_gained(folder, tmp_path, capsys):
    assert run(folder, tmp_path / "again.toml") == 0
    out = capsys.readouterr().out
    for words in ("tolerance", "held back", "segment F1 of detect", "--config"):
        assert words in out


def test_goes_on_after_an_interruption(folder, tuned, tmp_path, monkeypatch, capsys):
    from gmmjax.tuning.search import Search

    out, state = tmp_path / "later.toml", tmp_path / "later.progress.npz"
    step = Search.step

    def interrupted(self, own):
        if own.steps == 1:
            raise KeyboardInterrupt
        return step(self, own)

    with monkeypatch.context() as patch:
        patch.setattr(Search, "step", interrupted)
        assert run(folder, out) == 130
    assert state.is_file() and not out.exists()
    capsys.readouterr()
    assert run(folder, out) == 0
    assert "Going on after step 1" in capsys.readouterr().err
    assert out.read_text() == tuned.read_text() and not state.exists()


def test_a_state_of_other_settings_is_not_taken_up(folder, tmp_path, capsys):
    from gmmjax.reporting.tuning_files import write_state
    from gmmjax.tuning import TuningState

    one = np.zeros((1, 1, 1))
    write_state(tmp_path / "other.progress.npz", TuningState(one[0], (), one[0, 0] > 0, one, one, one[0, 0]), "other")
    assert run(folder, tmp_path / "other.toml") == 2
    assert "--restart" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--out", "tuned.txt"], "must end in .toml"),
        (["--out", "missing/tuned.toml"], "there is no folder missing"),
        (["--steps", "0"], "steps=0"),
        (["--parameters", "covariance_scale"], "go together"),
        (["--validation-share", "2"], "validation_share"),
    ],
)
def test_bad_usage_is_named(folder, tmp_path, capsys, more, message):
    assert run(folder, tmp_path / "bad.toml", *more) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_files_that_are_there_are_kept(folder, tuned, capsys):
    before = tuned.read_text()
    assert run(folder, tuned) == 2
    assert "--overwrite" in capsys.readouterr().err and tuned.read_text() == before
