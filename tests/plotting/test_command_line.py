"""`gmmjax detect --plot` and `gmmjax fit --plot`."""

import numpy as np
import pytest
from PIL import Image

from gmmjax.cli import main
from tests.batch.runs import FLAGS, cloud


@pytest.fixture(autouse=True)
def no_compilation_cache(monkeypatch):
    """JAX's own variable keeps the command line from changing JAX's settings for the other tests."""
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")


@pytest.fixture
def scans(tmp_path):
    files = [tmp_path / f"{name} $x_1$.npy" for name in ("before", "after")]
    for file, points in zip(files, (cloud(0, 4), cloud(1)), strict=True):
        np.save(file, points)
    return [str(file) for file in files]


@pytest.mark.slow
def test_detect_and_fit_draw_what_they_found(scans, tmp_path, capsys):
    # The folder of the results, which is made, is as good as one that is there.
    plot = tmp_path / "a" / "changes.png"
    words = ["detect", *scans, "--out", str(tmp_path / "a"), *FLAGS, "--plot", str(plot)]
    assert main(words) == 0
    # A long path is not broken.
    assert f"Plot in {plot}" in capsys.readouterr().out.replace("\n", "")
    picture = np.asarray(Image.open(plot).convert("RGB")).astype(int)
    # What appeared is green.
    assert ((picture - [0x00, 0x9E, 0x73]) == 0).all(axis=2).sum() > 100
    mixture = tmp_path / "b" / "fit.svg"
    words = ["fit", scans[1], "--out", str(tmp_path / "b"), "--max-components", "8", "--restarts", "1"]
    assert main([*words, "--plot", str(mixture)]) == 0
    assert "</svg>" in mixture.read_text()


@pytest.mark.parametrize("command", ["detect", "fit"])
def test_a_plot_that_cannot_be_written_is_told_before_the_work(command, scans, tmp_path, capsys):
    words = [command, *scans[: 2 if command == "detect" else 1], "--out", str(tmp_path / "out")]
    for name, message in (("x.docx", "matplotlib writes no figures with the ending '.docx'"), ("no/x.png", "missing")):
        assert main([*words, "--plot", str(tmp_path / name)]) == 2
        captured = capsys.readouterr()
        assert message in captured.err and captured.err.count("\n") == 1 and not captured.out
    assert not (tmp_path / "out").exists()


def test_a_map_that_cannot_be_written_is_told_before_the_work(scans, tmp_path, capsys):
    words = ["detect", *scans, "--out", str(tmp_path / "out")]
    for name, message in (("x.docx", "matplotlib writes no figures"), ("no/x.png", "missing"), ("no/x.tif", "missing")):
        if name.endswith(".tif"):
            pytest.importorskip("rasterio")
        assert main([*words, "--map-2d", str(tmp_path / name)]) == 2
        assert message in capsys.readouterr().err.replace("\n", " ")
    assert not (tmp_path / "out").exists()


def test_there_is_no_map_of_the_scans_of_a_depth_camera(tmp_path, capsys):
    points = np.random.default_rng(0).uniform([-0.5, -0.5, 1.0], [0.5, 0.5, 2.0], (500, 3))
    for name in ("before", "after"):
        np.save(tmp_path / f"{name}.npy", points)
    words = ["detect", *(str(tmp_path / f"{name}.npy") for name in ("before", "after")), "--out", str(tmp_path / "out")]
    assert main([*words, "--map-2d", str(tmp_path / "out" / "map.png")]) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert "--map-2d: the scans look like those of a depth camera" in message and message.endswith("or leave it out")
    assert not (tmp_path / "out").exists()
