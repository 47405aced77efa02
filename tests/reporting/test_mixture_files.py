import json

import jax
import numpy as np
import pytest

from gmmjax.errors import InputError
from gmmjax.mixtures import Fit, FitStatus, GaussianMixture
from gmmjax.reporting import read_mixture, write_mixture


@pytest.fixture
def fit():
    """Two live components in four slots."""
    mixture = GaussianMixture(
        weights=np.array([0.25, 0, 0.75, 0]),
        means=np.arange(12.0).reshape(4, 3) / 7,
        covariances=np.stack([np.eye(3) * scale for scale in (0.1, 1, 0.3, 1)]),
        live=np.array([True, False, True, False]),
    )
    scores = np.array(12.5), np.array(-10.25), np.array(30)
    return Fit(mixture, *scores, FitStatus.converged, np.array(64), np.array(0.0))


@pytest.fixture
def folder(fit, tmp_path):
    return write_mixture(tmp_path / "mixture", fit, source="scan.ply", settings={"seed": 0})


@pytest.mark.parametrize("name", ["", "mixture.json"])
def test_live_components_are_read_back_exactly(folder, fit, name):
    live = fit.mixture.live_part()
    mixture = read_mixture(folder / name)
    for read, written in zip(jax.tree.leaves(mixture), jax.tree.leaves(live), strict=True):
        np.testing.assert_array_equal(read, written)


def test_the_arrays_are_the_same_in_both_files(folder):
    content = json.loads((folder / "mixture.json").read_text())
    with np.load(folder / "mixture.npz", allow_pickle=False) as arrays:
        for name in ("weights", "means", "covariances"):
            np.testing.assert_array_equal(arrays[name], content[name])
    assert content["status"] == "converged"
    assert content["components"] == 2
    assert content["source"] == "scan.ply"
    assert content["settings"] == {"seed": 0}


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ({"schema_version": 99}, "schema version 99"),
        ({"weights": [1.0]}, "not a complete mixture"),
        ({"means": "far"}, "not a complete mixture"),
        ({"covariances": None}, "not a complete mixture"),
    ],
)
def test_damaged_files_are_refused(folder, damage, message):
    file = folder / "mixture.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **damage}))
    with pytest.raises(InputError, match=message):
        read_mixture(folder)


@pytest.mark.parametrize("text", ["", "[]", "{", "{}"])
def test_other_files_are_refused(tmp_path, text):
    (tmp_path / "mixture.json").write_text(text)
    with pytest.raises(InputError, match=r"mixture\.json"):
        read_mixture(tmp_path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="nowhere: no such file"):
        read_mixture(tmp_path / "nowhere")
