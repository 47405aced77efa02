import numpy as np
import pytest

from gmmjax.thesis.chapter4 import clustering
from gmmjax.thesis.chapter4.clustering import fixed_cloud, number_row


@pytest.fixture
def small(monkeypatch):
    """An eighth of the points, two starts."""
    monkeypatch.setattr(clustering, "fixed_cloud", lambda cloud, seed: fixed_cloud(cloud, seed)[::8])
    monkeypatch.setattr(clustering, "RESTARTS", 2)


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
