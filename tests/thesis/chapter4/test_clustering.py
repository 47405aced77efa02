import functools

import numpy as np
import pytest

from gmmjax import mixtures
from gmmjax.thesis.chapter4 import clustering
from gmmjax.thesis.chapter4.clustering import fixed_cloud, number_row, score_rows


@pytest.fixture
def small(monkeypatch):
    """An eighth of the points, diagonal covariances, two starts."""
    one_type = functools.partial(mixtures.grid_search, covariance_types=("diagonal",))
    fewer = {"fixed_cloud": lambda cloud, seed: fixed_cloud(cloud, seed)[::8], "RESTARTS": 2}
    for name, value in fewer.items():
        monkeypatch.setattr(clustering, name, value)
    return functools.partial(monkeypatch.setattr, clustering, "grid_search", one_type)


def test_scores_of_the_grid_search(small):
    """Every criterion has one lowest score, and three Gaussians are never the best for four."""
    small()
    (table,) = clustering.grid([3], lambda stage, share: None).tables
    assert len(table.rows) == 2 * 3 * 6 and len(table.brief) == 2 * 3
    for row in table.brief:
        own = [other for other in table.rows if all(other[name] == row[name] for name in ("cloud", "criterion"))]
        assert row["score"] == min(other["score"] for other in own)
        assert row["gaussians"] > 3


def test_a_model_that_failed_has_no_score():
    scores = np.arange(24.0).reshape(4, 6)
    scores[0, 0] = np.inf
    types = ("full", "tied", "diagonal", "spherical")
    rows = score_rows("4 Gaussians", dict.fromkeys(("mdl", "bic", "aic"), scores), types)
    assert rows[0]["score"] is None and not rows[0]["lowest"]
    assert rows[1]["lowest"] and rows[1]["covariances"] == "full" and rows[1]["gaussians"] == 4


def test_numbers_of_gaussians_that_were_found():
    row = number_row("grid search", "4 Gaussians", [4, 4, 5, 4, 4, 4])
    assert (row["fits"], row["right"], row["share"], row["found"]) == (6, 5, 0.8333, "4: 5, 5: 1")


def test_clouds_are_clustered_and_the_changes_found(small):
    first, second = clustering.clustering([0], lambda stage, share: None).tables
    assert [(row["cloud"], row["fits"]) for row in first.rows[:2]] == [("4 Gaussians", 2), ("4 Gaussians", 1)]
    assert [row["fits"] for row in second.rows] == [1, 1] and second.rows[0]["right"] == 1
    titles = [ax.get_title() for ax in first.figure.axes]
    # Of an eighth of the points the best of two starts finds four or five.
    number = int(first.rows[1]["found"].split(":")[0])
    assert number in (4, 5) and titles[0] == f"4 Gaussians: {number} found" and titles[2].startswith("appeared: ")
    assert np.linalg.norm(clustering._appeared(0).means - 2.5, axis=1).min() < 0.2
