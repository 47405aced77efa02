import numpy as np

from gmmjax.evaluation.reliability import NOTHING, Reliability
from gmmjax.reporting.reliability_plot import reliability_html


def test_the_plot_stands_alone():
    curve = Reliability.of(np.array([0.2, 0.9, 0.95]), np.array([False, True, True]))
    page = reliability_html({"joint": {"changes": NOTHING.to_dict(), "points": curve.to_dict()}})
    assert "joint, points" in page and "joint, changes" not in page
    assert "cdn" not in page.split("<body>")[0]
    assert len(page) > 1_000_000
