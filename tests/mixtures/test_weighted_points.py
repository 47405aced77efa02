import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.mixtures.weighted_points import WeightedPoints, bucket


@given(size=st.integers(1, 10**6))
def test_buckets_hold_the_points_and_waste_at_most_a_half(size):
    assert size <= bucket(size) <= max(256, 1.5 * size)
    assert bucket(bucket(size)) == bucket(size)


def test_few_buckets():
    assert [bucket(size) for size in (1, 257, 400, 513, 800, 16384, 16385)] == [256, 384, 512, 768, 1024, 16384, 24576]


def test_padding_has_no_mass_and_stays_within_the_cloud():
    points = np.random.default_rng(0).normal(size=(300, 3)) + 1e6
    padded = WeightedPoints(points, np.full(300, 2.0)).padded()
    assert len(padded.mass) == 384
    np.testing.assert_array_equal(padded.points[:300], points)
    assert padded.mass.sum() == 600
    assert (padded.points[300:] == points[0]).all()
