import re
import runpy
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from matplotlib import pyplot
from PIL import Image

ROOT = Path(__file__).parents[1]
EXPECTED = {
    "compare_mixtures.py": ["EMD 0.661", "[0.055 0.183 0.   ]", "Sinkhorn"],
    "detect_two_files.py": ["after: 300 of 1500 points changed"],
    "registration_error.py": ["panorama normal", "panorama hard", "frame normal"],
    "fit_a_mixture.py": ["3 Gaussians", "from six starts: [3, 3, 3, 3, 3, 3]"],
    "align_by_gradient.py": ["before: 49.62 mm and 3.000 degrees off", "and 0.0"],
    "many_pairs.py": ["scene 1 1 changes", "2 restarts: 3 pairs, 0 of them", "4 restarts: 3 pairs"],
    "maps_from_bags.py": ["run5.bag: 10 frames", "refined: True"],
    "restarts_and_priors.py": ["greedy", "joint", "4 restarts", "wrong noise floor 0.70 m", "tuned noise floor"],
    "thesis_figures.py": ["before and after: [4, 7]", "EMD 0.83 m", "grid search: 7 Gaussians, full", "joint: F1 1.00"],
    "tune_the_verdict.py": ["1 unseen pairs, poses unknown", "shipped", "tuned on 2 labelled"],
    "tune_to_a_sensor.py": ["0.571", "1.000", "derived"],
}
# The changes that an example reports by kind, in the order of x, metres: the last digit differs between machines.
CHANGES = {
    "detect_two_files.py": {"disappeared": [[1.1, -1.85, -3.71]], "appeared": [[-2.59, 2.92, 0.35]]},
    "maps_from_bags.py": {"appeared": [[-0.67, 0.73, 0.37], [0.02, 0.85, 0.9]]},
}
# Smaller than by default, where an example takes long.
ARGUMENTS = {
    "align_by_gradient.py": ["--points", "1000"],
    "registration_error.py": ["--rooms", "1"],
    "restarts_and_priors.py": ["--restarts", "16", "--steps", "4"],
    "thesis_figures.py": ["--seeds", "1", "--detectors", "joint"],
    "tune_the_verdict.py": ["--every", "4"],
    "tune_to_a_sensor.py": ["--steps", "1", "--starts", "1", "--points", "200", "--max-points", "300"],
}


def changes_of(printed: str) -> dict[str, list[list[float]]]:
    """By kind, where an example says that changes are."""
    found: dict[str, list[list[float]]] = {}
    for kind, centre in re.findall(r"(\w+) at \[([^]]*)\]", printed):
        found.setdefault(kind, []).append([float(number) for number in centre.split(",")])
    return found


def test_every_example_is_run_here():
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == set(EXPECTED)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_the_example_says_and_draws_what_it_should(name, tmp_path, monkeypatch, capsys, no_workers):
    """Warnings are errors; types are promoted, as for users."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, *ARGUMENTS.get(name, []), "--plot", "picture.png"])
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    pyplot.close("all")
    printed = capsys.readouterr().out
    for words in EXPECTED[name]:
        assert words in printed
    expected, found = CHANGES.get(name, {}), changes_of(printed)
    assert found.keys() == expected.keys()
    for kind, centres in expected.items():
        np.testing.assert_allclose(sorted(found[kind]), centres, atol=0.02, err_msg=kind)
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    picture = np.asarray(Image.open(tmp_path / "picture.png").convert("RGB"))
    assert min(picture.shape[:2]) > 300
    # Points, bars or arrows, and not the empty frame of a plot alone.
    assert (picture != 255).any(axis=2).mean() > 0.03


def test_the_gallery_shows_the_picture_and_the_command_of_every_example():
    page = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    for name in EXPECTED:
        picture = f"images/example-{name.removesuffix('.py').replace('_', '-')}.png"
        assert f"({picture})" in page
        assert (ROOT / "docs" / picture).exists()
        assert f"python examples/{name}" in page
