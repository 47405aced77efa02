"""Plots of mixtures: the Gaussians over their points, and transport between two mixtures."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from gmmjax.clouds import PointCloud, require_array
from gmmjax.errors import InputError
from gmmjax.mixtures import GaussianMixture
from gmmjax.plotting.axes import COLORS, INK, Style, axes_or_new, legend_below, verbatim
from gmmjax.plotting.cloud_image import MAX_POINTS, PIXELS, Page, cloud_picture, flat_colors
from gmmjax.plotting.projection import Direction, Projection
from gmmjax.reporting.palette import KIND_COLORS, color_bytes
from gmmjax.reporting.splats import thinned
from gmmjax.transport import TransportResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# What a mixture in 2-D is drawn on.
PLANE = Projection(np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], ("x", "y"))
BEFORE_COLOR, AFTER_COLOR = KIND_COLORS["disappeared"], KIND_COLORS["moved"]


def plot_mixture(
    mixture: GaussianMixture,
    points: ArrayLike | PointCloud | None = None,
    *,
    direction: Direction = "oblique",
    deviations: float = 2.0,
    numbers: bool = True,
    unit: str | None = None,
    ax: "Axes | None" = None,
    pixels: int = PIXELS,
) -> "Axes":
    """Draw the Gaussians of a mixture as ellipses, over the points that it was fitted to.

    An ellipse is where the projected Gaussian is at this number of standard deviations. Points have the colour of their
    most probable Gaussian; there are six colours, so that the Gaussians of a larger mixture share them.

    Args:
        mixture: in 2-D or 3-D.
        points: coordinates, in the unit of the mixture; None: only the ellipses are drawn.
        direction: from which a mixture in 3-D is seen: "oblique", "above", "front" or "side".
        deviations: of the ellipses.
        numbers: whether each Gaussian has its slot's number at its mean.
        unit: of the coordinates, for the labels.
        ax: where to draw; None: a new figure.
        pixels: of the longer edge of the picture of the points.

    Raises:
        InputError: a mixture of another dimension than 2 and 3, or without any component; points of another dimension.
    """
    live = _live(mixture, "mixture")
    coordinates = None if points is None else _points_of(points, mixture.dimension)
    seen = live.means if coordinates is None else _in_space(coordinates)
    ax = axes_or_new(ax, (7.0, 6.0))
    projection = Projection.of(direction, seen) if mixture.dimension == 3 else PLANE
    page = Page.around(projection, seen, live.reach(projection, deviations), pixels)
    colors = [COLORS[slot % len(COLORS)] for slot in range(len(mixture.live))]
    if coordinates is not None:
        rows = thinned(np.arange(len(coordinates)), MAX_POINTS // 4)
        # Half way to white, under their ellipse.
        pale = ["#" + "".join(f"{(value + 255) // 2:02x}" for value in color_bytes(color)) for color in colors]
        tints = flat_colors(pale, np.asarray(mixture.labels(coordinates[rows])))
        page.draw(cloud_picture(seen[rows], tints, page), ax, 1)
    means = _draw_ellipses(ax, live, projection, deviations, [colors[slot] for slot in live.slots])
    for slot, mean in zip(live.slots if numbers else [], means, strict=False):
        ax.annotate(str(slot), tuple(mean), ha="center", va="center", fontsize="small", color=INK, zorder=5)
    page.dress(ax, unit)
    return ax


def plot_transport(
    before: GaussianMixture,
    after: GaussianMixture,
    result: TransportResult,
    *,
    direction: Direction = "oblique",
    deviations: float = 1.0,
    unit: str | None = None,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a transport plan between two mixtures: the flow of mass from Gaussian to Gaussian.

    The width of an arrow is proportional to the mass that moves; what stays within a standard deviation has none.
    Gaussians of the before mixture are orange ellipses, those of the after mixture blue.

    Args:
        before: of the first survey.
        after: of the second survey, in the same unit and dimension, 2 or 3.
        result: of `earth_movers_distance(before, after)`, or of another solver on the same components.
        direction: as of `plot_mixture`.
        deviations: standard deviations of the ellipses.
        unit: of the coordinates and of the cost, for the labels.
        ax: where to draw; None: a new figure.

    Raises:
        InputError: mixtures that cannot be drawn; a plan of other mixtures.
    """
    plan = np.asarray(result.plan, float)
    if plan.shape != (len(before.live), len(after.live)):
        raise InputError(
            f"result: has a plan of {list(plan.shape)}, the mixtures have {len(before.live)} and {len(after.live)} "
            "slots; give the result of these two"
        )
    sides = _live(before, "before"), _live(after, "after")
    ax = axes_or_new(ax, (7.0, 6.0))
    means = np.concatenate([side.means for side in sides])
    projection = Projection.of(direction, means) if before.dimension == 3 else PLANE
    page = Page.around(projection, means, np.concatenate([side.reach(projection, deviations) for side in sides]))
    for side, color in zip(sides, (BEFORE_COLOR, AFTER_COLOR), strict=True):
        _draw_ellipses(ax, side, projection, deviations, [color] * len(side.slots))
    _draw_flow(ax, plan[np.ix_(sides[0].slots, sides[1].slots)], *sides, projection)
    page.dress(ax, unit)
    verbatim(ax.title).set_text(f"transport cost {float(result.cost):.3g}{f' {unit}' if unit else ''}")
    _transport_legend(ax)
    return ax


class _Live(NamedTuple):
    """The live components of a mixture on the host, those in 2-D on the plane z = 0."""

    slots: list[int]
    means: Float[np.ndarray, "k 3"]
    covariances: Float[np.ndarray, "k 3 3"]

    def reach(self, projection: Projection, deviations: float) -> Float[np.ndarray, "m 3"]:
        """Return points that are as far on the page as the ellipses."""
        variances = np.diagonal(projection.covariance_on_page(self.covariances), axis1=1, axis2=2)
        width, height = deviations * np.sqrt(np.maximum(variances, 0)).T[..., None]
        across, upwards = width * projection.right, height * projection.up
        return np.concatenate([self.means + across + upwards, self.means - across - upwards])


def _live(mixture: GaussianMixture, name: str) -> _Live:
    if np.asarray(mixture.means).ndim != 2:
        raise InputError(f"{name}: must be one mixture, not a batch of them; choose one, such as with best_fit")
    if mixture.dimension not in (2, 3):
        raise InputError(f"{name}: has {mixture.dimension} dimensions; only mixtures in 2-D and 3-D can be drawn")
    live = np.flatnonzero(np.asarray(mixture.live))
    if not len(live):
        raise InputError(f"{name}: has no live component; there is nothing to draw")
    own, missing = np.asarray(mixture.covariances, float)[live], 3 - mixture.dimension
    covariances = np.pad(own, ((0, 0), (0, missing), (0, missing)))
    return _Live(live.tolist(), _in_space(np.asarray(mixture.means, float)[live]), covariances)


def _points_of(points: ArrayLike | PointCloud, dimension: int) -> np.ndarray:
    given = points.points if isinstance(points, PointCloud) else points
    require_array(given, "points")
    coordinates = np.asarray(given, float)
    if coordinates.ndim != 2 or coordinates.shape[1] != dimension:
        raise InputError(f"points: must be [n, {dimension}], as the mixture is, not {list(coordinates.shape)}")
    if not len(coordinates) or not np.isfinite(coordinates).all():
        raise InputError("points: must be finite, and at least one; leave out the rows with NaN")
    return coordinates


def _in_space(points: np.ndarray) -> Float[np.ndarray, "n 3"]:
    """Put points in 2-D on the plane z = 0."""
    return np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def _draw_ellipses(
    ax: "Axes", live: _Live, projection: Projection, deviations: float, colors: list[str]
) -> Float[np.ndarray, "k 2"]:
    """Draw the Gaussians on the page, and return their means on it."""
    from matplotlib.patches import Ellipse

    means, covariances = projection.on_page(live.means), projection.covariance_on_page(live.covariances)
    for mean, covariance, color in zip(means, covariances, colors, strict=True):
        variances, axes = np.linalg.eigh(covariance)
        width, height = 2 * deviations * np.sqrt(np.maximum(variances[::-1], 0))
        angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
        style: Style = {"facecolor": (color, 0.12), "edgecolor": color, "linewidth": 1.4, "zorder": 3}
        ax.add_patch(Ellipse(tuple(mean), width, height, angle=angle, **style))
    return means


def _draw_flow(ax: "Axes", plan: np.ndarray, before: _Live, after: _Live, projection: Projection) -> None:
    """Draw an arrow for each mass that moves; negligible ones of an entropic plan are left out."""
    from matplotlib.patches import FancyArrowPatch

    sources, targets = projection.on_page(before.means), projection.on_page(after.means)
    covariances = projection.covariance_on_page(before.covariances)
    for row, column in np.argwhere(plan > 0.002 * plan.sum()):
        offset = targets[column] - sources[row]
        # Mass that moves within a standard deviation stays where it is.
        if offset @ np.linalg.lstsq(covariances[row], offset)[0] <= 1:
            continue
        width = 0.5 + 4.0 * plan[row, column] / plan.max()
        style: Style = {"arrowstyle": "-|>", "mutation_scale": 8 + 2 * width, "shrinkA": 2, "shrinkB": 2}
        ends = tuple(sources[row]), tuple(targets[column])
        ax.add_patch(FancyArrowPatch(*ends, linewidth=width, color="0.35", alpha=0.7, zorder=4, **style))


def _transport_legend(ax: "Axes") -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    sides = {"before": BEFORE_COLOR, "after": AFTER_COLOR}
    handles = [Patch(facecolor="none", edgecolor=color, label=name) for name, color in sides.items()]
    legend_below(ax, [*handles, Line2D([], [], color="0.35", linewidth=2.5, label="flow of mass")])
