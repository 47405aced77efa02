import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gmmjax
from gmmjax.clouds import PointCloud, as_points, require_array
from gmmjax.errors import InputError

# Not in this process, where the types of arguments are checked before anything else.
FUNCTIONS = """
import sys
from pathlib import Path

import jax

import gmmjax
from gmmjax.changes import detect_consensus
from gmmjax.clouds import voxel_grid
from gmmjax.errors import InputError

for path in ("a.ply", Path("a.ply")):
    for call in (
        lambda: gmmjax.detect_changes(path, path),
        lambda: detect_consensus(path, path),
        lambda: gmmjax.fit_mixture(path, key=jax.random.key(0)),
        lambda: gmmjax.fit_mixture(path, key=jax.random.key(0), method="grid"),
        lambda: gmmjax.PointCloud.from_rows(path),
        lambda: gmmjax.SensorViews.at_origin(path),
        lambda: voxel_grid(path, 0.1),
    ):
        try:
            call()
        except InputError as error:
            print("read_cloud" in str(error))
for call, told in (
    (lambda: gmmjax.detect_changes(None, None), "before: is None, not an array [N, 3]"),
    (lambda: gmmjax.detect_changes({}, {}), "before: is {}, not an array [N, 3]"),
    (lambda: gmmjax.read_cloud(["a.ply", "b.ply"]), "read those of one survey with gmmjax.read_survey"),
):
    try:
        call()
    except InputError as error:
        print(told in str(error))
"""


@pytest.mark.parametrize("path", ["a.ply", Path("a.ply"), ["a.ply", "b.ply"], b"a.ply"])
def test_a_path_is_to_be_read(path):
    with pytest.raises(InputError, match=r"before: is b?'a.ply', [^;]*; .*read_cloud\(path\), .*read_survey\(paths\)"):
        require_array(path, "before")


def test_a_cloud_is_no_array():
    with pytest.raises(InputError, match=r"points: is a PointCloud, .*give its attribute points"):
        require_array(PointCloud.from_rows(np.zeros((1, 3))), "points")


@pytest.mark.slow
def test_functions_of_points_say_how_a_file_is_read():
    done = subprocess.run([sys.executable, "-c", FUNCTIONS], capture_output=True, text=True)
    assert done.stdout.split() == ["True"] * 17, done.stderr


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([PointCloud.from_rows(np.zeros((1, 3)))], "is a list of clouds; give one"),
        (np.array(["a.ply", "b.ply"]), r"is 'a.ply', .*read_cloud"),
        (SimpleNamespace(vertices=np.zeros((1, 3))), "give its attribute vertices"),
    ],
)
def test_what_is_no_array_of_points_is_named(values, message):
    with pytest.raises(InputError, match=f"points: .*{message}"):
        require_array(values, "points")


def test_what_is_masked_has_no_position():
    masked = np.ma.masked_greater(np.arange(6).reshape(2, 3), 4)
    np.testing.assert_array_equal(as_points(masked), [[0, 1, 2], [3, 4, np.nan]])


def test_a_survey_of_one_file_may_be_given_by_its_path(tmp_path):
    np.savetxt(tmp_path / "a.xyz", np.eye(3))
    assert len(gmmjax.read_survey(tmp_path / "a.xyz")) == 3
