"""The clouds and mixtures of chapter 4 as plots in two and three dimensions, as plain data for plotly.js."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from gmmjax.mixtures import GaussianMixture
from gmmjax.thesis.chapter4 import Outcome, clustering, filtering
from gmmjax.thesis.report.bar_charts import FONT, LINE, Chart, axes_of, panel_title

COLORS = (
    *("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#8C6BB1", "#7A5C3E", "#4D4D4D", "#B8A90B"),
)
GREY, CHANGED = "#b9bec5", "#009E73"
SIDES = ("before", "after")
TOP_COLORS = {"before": "#0072B2", "after": "#E69F00", "changed": CHANGED, "outliers": "#D4005A"}
# Points of each cloud that are drawn.
DRAWN = 1500
# Semi-axes of the ellipsoids, standard deviations.
ELLIPSOID_SCALE = 2.0
# Vertices of an ellipsoid along its two angles.
LATITUDES, LONGITUDES = 13, 25


class View(NamedTuple):
    """A plot in three dimensions with its heading and caption."""

    heading: str
    caption: str
    chart: Chart


def annihilation_views(outcomes: Sequence[Outcome]) -> list[View]:
    """Figure 4.1: the mixture of four Gaussians, that of seven, and the Gaussians found to have appeared."""
    views = [_clustered(outcome) for outcome in _first(outcomes, clustering.ANNIHILATION)]
    for outcome in _first(outcomes, clustering.CHANGES):
        mixture = clustering.mixture_of(outcome.result)
        points = _some(clustering.fixed_cloud("7 Gaussians", outcome.seed))
        traces = [_points(points, GREY), *_ellipsoids(mixture, [CHANGED] * len(mixture.weights))]
        views.append(View("Changes", f"{len(mixture.weights)} appeared", {"data": traces, "layout": _space()}))
    return views


def grid_views(outcomes: Sequence[Outcome]) -> list[View]:
    """Figure 4.2: both clouds as the grid search clusters them, and the first other one with a wrong number."""
    first = _first(outcomes, clustering.GRID)
    others = [own for own in outcomes if own.method == clustering.GRID and own not in first]
    wrong = [own for own in others if own.result["best"] != clustering.CLOUDS[own.condition] == 7]
    return [_clustered(outcome) for outcome in (*first, *wrong[:1])]


def top_views(outcomes: Sequence[Outcome]) -> Chart | None:
    """Figure 4.6: both localised maps from above, without and with the outlier filter; None: they were not run."""
    pictures = [outcome.result for outcome in outcomes if outcome.method == filtering.CLOUDS]
    if not pictures:
        return None
    (picture,) = pictures
    traces = [trace for panel in (1, 2) for trace in _top(picture, panel)]
    return {"data": traces, "layout": _plane(picture)}


def _first(outcomes: Sequence[Outcome], method: str) -> list[Outcome]:
    own = [outcome for outcome in outcomes if outcome.method == method]
    return [outcome for outcome in own if outcome.seed == own[0].seed]


def _clustered(outcome: Outcome) -> View:
    """The points in the colour of the Gaussian with the largest responsibility."""
    mixture = clustering.mixture_of(outcome.result)
    points = _some(clustering.fixed_cloud(outcome.condition, outcome.seed))
    owners = _owners(mixture, points)
    colors = [COLORS[number % len(COLORS)] for number in range(len(mixture.weights))]
    traces = [_points(points[owners == number], color) for number, color in enumerate(colors)]
    caption = f"{len(mixture.weights)} found, seed {outcome.seed}"
    return View(outcome.condition, caption, {"data": traces + _ellipsoids(mixture, colors), "layout": _space()})


def _some(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    return points[np.random.default_rng(0).choice(len(points), min(DRAWN, len(points)), replace=False)]


def _owners(mixture: GaussianMixture, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    with jax.enable_x64(True):
        return np.asarray(mixture.log_joint(points)).argmax(axis=1)


def _points(points: Float[np.ndarray, "n 3"], color: str) -> Chart:
    places = dict(zip("xyz", points.T.round(3).tolist(), strict=True))
    return {
        "type": "scatter3d",
        "mode": "markers",
        "hoverinfo": "skip",
        "marker": {"size": 1.7, "color": color},
        **places,
    }


def _ellipsoids(mixture: GaussianMixture, colors: Sequence[str]) -> list[Chart]:
    """The surface of each Gaussian at two standard deviations."""
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, LATITUDES), np.linspace(0, 2 * np.pi, LONGITUDES))
    sphere = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
    traces = []
    for mean, covariance, color in zip(mixture.means, mixture.covariances, colors, strict=True):
        surface = mean + ELLIPSOID_SCALE * sphere @ np.linalg.cholesky(covariance).T
        places = dict(zip("xyz", np.moveaxis(surface, -1, 0).round(3).tolist(), strict=True))
        look = {"colorscale": [[0, color], [1, color]], "showscale": False, "opacity": 0.3, "hoverinfo": "skip"}
        traces.append({"type": "surface", **look, **places})
    return traces


def _space() -> Chart:
    axis = {"title": {"text": ""}, "showticklabels": False, "gridcolor": LINE, "zeroline": False, "showspikes": False}
    scene = {f"{name}axis": {**axis, "backgroundcolor": "#f7f8fa", "showbackground": True} for name in "xyz"}
    camera = {"eye": {"x": 1.15, "y": -1.25, "z": 0.7}}
    return {
        "scene": {**scene, "aspectmode": "data", "camera": camera},
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "showlegend": False,
        "paper_bgcolor": "#f7f8fa",
    }


def _top(picture: Mapping[str, Any], panel: int) -> list[Chart]:
    """The points of both clouds, of true changes, and outliers as separate traces; the second panel has no outliers."""
    places = np.concatenate([np.array(picture[side]["places"]).reshape(-1, 2) for side in SIDES]) / 1000
    kept, changed = (
        np.concatenate([picture[side][name] for side in SIDES]).astype(bool) for name in ("kept", "changed")
    )
    after = np.repeat([False, True], [len(picture[side]["places"]) for side in SIDES])
    shown = {
        "before": kept & ~changed & ~after,
        "after": kept & ~changed & after,
        "changed": kept & changed,
        "outliers": ~kept & (panel == 1),
    }
    return [_dots(name, places[own], panel) for name, own in shown.items()]


def _dots(name: str, places: Float[np.ndarray, "n 2"], panel: int) -> Chart:
    x, y = places.T.round(3).tolist()
    size = 4 if name == "outliers" else 2.6
    return {
        **{"type": "scatter", "mode": "markers", "hoverinfo": "skip", "x": x, "y": y, **axes_of(panel)},
        **{"name": name, "legendgroup": name, "showlegend": panel == 1},
        "marker": {"size": size, "color": TOP_COLORS[name], "opacity": 0.7},
    }


def _plane(picture: Mapping[str, Any]) -> Chart:
    sides = [picture[side] for side in SIDES]
    points, left = (sum(side[name] for side in sides) for name in ("points", "left"))
    titles = (f"voxel filter only: {points:,} points", f"and outlier filter: {left:,} points")
    places = np.concatenate([np.array(side["places"]) for side in sides]) / 1000
    lower, upper = places.min(axis=0) - 0.1, places.max(axis=0) + 0.1
    layout: Chart = {
        "height": 520,
        "font": {**FONT, "size": 13},
        "margin": {"l": 64, "r": 12, "t": 64, "b": 36},
        "plot_bgcolor": "#ffffff",
        "legend": {"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top", "itemsizing": "constant"},
        "annotations": [],
    }
    for number, (title, left_end) in enumerate(zip(titles, (0.0, 0.54), strict=True)):
        suffix = "" if number == 0 else "2"
        axis = {"gridcolor": LINE, "zeroline": False, "ticksuffix": " m"}
        layout[f"xaxis{suffix}"] = {**axis, "domain": [left_end, left_end + 0.46], "range": [lower[0], upper[0]]}
        layout[f"yaxis{suffix}"] = {**axis, "anchor": f"x{suffix}", "range": [lower[1], upper[1]]}
        layout[f"yaxis{suffix}"] |= {"scaleanchor": f"x{suffix}"}
        layout["annotations"].append(panel_title(title, left_end, 1.0))
    return layout
