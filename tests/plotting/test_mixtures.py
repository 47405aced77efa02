import jax
import numpy as np
import pytest
from matplotlib.patches import Ellipse, FancyArrowPatch

from gmmjax import Fit, FitStatus, GaussianMixture, InputError, earth_movers_distance
from gmmjax.mixtures import GridSearch
from gmmjax.plotting import (
    plot_grid_search,
    plot_message_length,
    plot_mixture,
    plot_transport,
)


def mixture(means, variances=(0.04, 0.01, 0.01), weights=None, dead=0):
    """Gaussians with the same principal variances along the axes, and dead slots before them."""
    means = np.asarray(means, float)
    count, dimension = means.shape
    covariances = np.tile(np.diag(variances[:dimension]), (count, 1, 1))
    weights = np.full(count, 1 / count) if weights is None else np.asarray(weights)
    empty = np.zeros((dead, dimension)), np.tile(np.eye(dimension), (dead, 1, 1))
    return GaussianMixture(
        np.r_[np.zeros(dead), weights],
        np.concatenate([empty[0], means]),
        np.concatenate([empty[1], covariances]),
        np.arange(dead + count) >= dead,
    )


def patches(ax, kind):
    return [patch for patch in ax.patches if isinstance(patch, kind)]


def fit(counts, lengths):
    """Restarts with these numbers of components and message lengths."""
    fits = []
    for count, length in zip(counts, lengths, strict=True):
        own = mixture(np.zeros((count, 3)), dead=5 - count)
        numbers = np.array(length), np.array(0.0), np.array(1)
        fits.append(Fit(own, *numbers, FitStatus.converged, np.array(64), np.array(0.0)))
    return jax.tree.map(lambda *leaves: np.stack(leaves), *fits)


def test_ellipses_are_the_projected_gaussians():
    """From above, x to the right: half axes of two standard deviations, .4 and .2, at the means."""
    ax = plot_mixture(mixture([[0, 0, 0], [3, 2, 1]], dead=2), direction="above", unit="m")
    found = patches(ax, Ellipse)
    np.testing.assert_allclose([ellipse.center for ellipse in found], [[0, 0], [3, 2]], atol=1e-12)
    np.testing.assert_allclose([[ellipse.width, ellipse.height] for ellipse in found], [[0.8, 0.4]] * 2)
    assert {ellipse.angle % 180 for ellipse in found} == {0}
    assert [text.get_text() for text in ax.texts] == ["2", "3"]
    assert (ax.get_xlabel(), ax.get_aspect()) == ("x (m)", 1)


def test_a_turned_gaussian_is_a_turned_ellipse():
    angle = np.radians(30)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    covariance = rotation @ np.diag([0.09, 0.01]) @ rotation.T
    turned = GaussianMixture(np.ones(1), np.zeros((1, 2)), covariance[None], np.ones(1, bool))
    (ellipse,) = patches(plot_mixture(turned, deviations=1.0), Ellipse)
    assert ellipse.angle % 180 == pytest.approx(30) and ellipse.width == pytest.approx(0.6)


def test_points_have_the_colour_of_their_gaussian():
    random = np.random.default_rng(0)
    means = np.array([[0.0, 0, 0], [2, 0, 0]])
    points = np.repeat(means, 200, axis=0) + 0.1 * random.normal(size=(400, 3))
    ax = plot_mixture(mixture(means), points, direction="above", pixels=120)
    picture = np.asarray(ax.images[0].get_array())
    left, right = (half[half[..., 3] > 0][:, :3].astype(int).mean(axis=0) for half in np.split(picture, [60], axis=1))
    assert left[2] > left[0] + 50 and right[0] > right[2] + 50  # blue, and orange


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda: plot_mixture(mixture([[0.0]], (1.0,))), "mixture: has 1 dimensions; only mixtures in 2-D and 3-D"),
        (
            lambda: plot_mixture(mixture(np.zeros((0, 3)), weights=np.zeros(0), dead=1)),
            "mixture: has no live component",
        ),
        (lambda: plot_mixture(mixture([[0, 0, 0]]), np.zeros((4, 2))), r"points: must be \[n, 3\].*not \[4, 2\]"),
        (lambda: plot_mixture(mixture([[0, 0, 0]]), np.full((4, 3), np.nan)), "points: must be finite"),
        (lambda: plot_message_length([]), "fits: none of them has a finite message length"),
    ],
)
def test_what_cannot_be_drawn_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        given()


def test_grid_search_marks_the_lowest_score():
    scores = np.array([[30.0, 10.0, 20.0], [40.0, np.inf, 15.0]])
    search = GridSearch(
        jax.tree.map(lambda leaf: leaf[0], fit([3], [1.0])),
        np.array(0),
        {"mdl": scores, "bic": scores[:, ::-1]},
        ("full", "tied"),
        (2, 3, 4),
    )
    ax = plot_grid_search(search)
    full, tied = ax.lines[:2]
    assert full.get_ydata().tolist() == [30, 10, 20] and np.isnan(tied.get_ydata()[1])
    assert [text.get_text() for text in ax.texts] == ["lowest: 3, full"]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["full", "tied"]
    assert ax.get_ylabel() == "MDL (nats)"
    assert [text.get_text() for text in plot_grid_search(search, criterion="bic").texts] == ["lowest: 3, full"]


def test_message_lengths_of_restarts_by_number():
    ax = plot_message_length([fit([2, 3, 3], [9.0, 7.0, 8.0]), fit([4], [np.inf])])
    shortest, each = ax.lines[:2]
    assert (shortest.get_xdata().tolist(), shortest.get_ydata().tolist()) == ([2, 3], [9, 7])
    assert len(each.get_xdata()) == 3
    assert [text.get_text() for text in ax.texts] == ["shortest: 3 Gaussians"]
    assert all(tick == round(tick) for tick in ax.get_xticks())


def test_flow_goes_from_what_is_gone_to_what_is_new():
    before = mixture([[0, 0, 0], [2, 0, 0]])
    after = mixture([[0, 0, 0], [2, 0, 0], [2, 3, 0]], weights=[0.5, 0.25, 0.25])
    with jax.enable_x64(True):
        result = earth_movers_distance(before, after)
    ax = plot_transport(before, after, result, direction="above", unit="m")
    (arrow,) = patches(ax, FancyArrowPatch)
    np.testing.assert_allclose(arrow._posA_posB, [[2, 0], [2, 3]], atol=1e-9)
    assert len(patches(ax, Ellipse)) == 5 and ax.get_title() == "transport cost 0.75 m"
    with pytest.raises(InputError, match=r"result: has a plan of \[2, 3\], the mixtures have 3 and 2 slots"):
        plot_transport(after, before, result)
