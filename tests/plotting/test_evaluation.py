import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.evaluation import Reliability, Row, Scores
from gmmjax.plotting import plot_reliability, plot_scores


def row(detector, condition, found):
    scores = Scores(true_segments=found, segments=10, found=found, changes=10)
    return Row(detector, "scenes", condition, 1, 0, scores, 0.1)


def test_bars_are_grouped_by_condition():
    rows = [row("joint", "(+1) $low_", 10), row("c2c", "(+1) $low_", 5), row("joint", "none", 8)]
    ax = plot_scores(rows)
    heights = [[bar.get_height() for bar in container] for container in ax.containers]
    assert heights == [pytest.approx([1.0, 0.8]), pytest.approx([0.5])]
    # The bar of the other detector stands beside that of the first one, in the same group.
    assert abs(ax.containers[1][0].get_x() - ax.containers[0][0].get_x()) < 0.5
    assert [label.get_text() for label in ax.get_xticklabels()] == ["(+1) $low_", "none"]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["joint", "c2c"]
    assert ax.get_ylabel() == "F1 of the segments"
    ax.figure.canvas.draw()
    with pytest.raises(InputError, match="rows: there are none"):
        plot_scores([])


def test_reliability_curves_have_their_intervals():
    probability = np.repeat([0.25, 0.85], 100)
    truth = np.r_[np.arange(100) < 20, np.arange(100) < 90]
    curve = Reliability.of(probability, truth)
    ax = plot_reliability({"joint": curve, "empty": Reliability.of(np.zeros(0), np.zeros(0, bool))})
    (container,) = ax.containers
    line, _, (bars,) = container.lines
    np.testing.assert_allclose(line.get_xydata(), [[0.25, 0.2], [0.85, 0.9]])
    # Wilson's interval of 20 in 100, from its table.
    np.testing.assert_allclose(bars.get_segments()[0][:, 1], [0.1334, 0.2888], atol=1e-4)
    (text,) = ax.get_legend().get_texts()
    assert text.get_text().startswith("joint\nBrier score 0.1") and ax.get_aspect() == 1
    assert plot_reliability(curve).get_legend().get_texts()[0].get_text().startswith("Brier")
    with pytest.raises(InputError, match="curves: have no probability"):
        plot_reliability({})
