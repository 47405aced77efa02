import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
EXPECTED = {
    "compare_mixtures.py": ["EMD 0.661", "[0.055 0.183 0.   ]", "Sinkhorn"],
    "detect_two_files.py": ["disappeared at [1.1,", "appeared at [-2.59,", "after: 300 of 1500 points changed"],
    "registration_error.py": ["panorama normal", "frame normal"],
    "fit_a_mixture.py": ["3 Gaussians", "from six starts: [3, 3, 3, 3, 3, 3]"],
    "align_by_gradient.py": ["before: 49.77 mm and 3.000 degrees off", "and 0.0"],
    "maps_from_bags.py": ["run5.bag: 10 frames", "refined: True", "appeared at [0.0, 0.", "at [-0.7, 0.7, 0.4]"],
    "tune_the_concentration.py": ["lenient", "tuned", "Figueiredo and Jain"],
    "tune_to_a_sensor.py": ["0.750", "1.000", "derived"],
}
# Smaller than by default, where an example takes long.
ARGUMENTS = {
    "align_by_gradient.py": ["--points", "1500"],
    "tune_the_concentration.py": ["--steps", "4"],
    "tune_to_a_sensor.py": ["--steps", "8"],
}


def test_every_example_is_run_here():
    assert {path.name for path in (ROOT / "examples").glob("*.py")} == set(EXPECTED)


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_the_example_says_what_it_should(name, tmp_path):
    """As a user runs it, in a process of its own; warnings are errors."""
    paths = [str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", ROOT / "examples" / name, *ARGUMENTS.get(name, [])],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in paths if path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    for words in EXPECTED[name]:
        assert words in done.stdout
    assert not list(tmp_path.iterdir())
