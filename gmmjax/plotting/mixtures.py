"""Plots of mixtures: the Gaussians over their points, the grid search, message lengths, transport between two."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from gmmjax.clouds import PointCloud, require_array
from gmmjax.errors import InputError, check_choice
from gmmjax.mixtures import CRITERIA, Criterion, Fit, GaussianMixture, GridSearch, failed
from gmmjax.plotting.cloud_image import CloudImageSettings, Page, cloud_picture, flat_colors
from gmmjax.plotting.figures import Style, axes_or_new, legend_below, light_frame, verbatim
from gmmjax.plotting.projection import Direction, Projection
from gmmjax.reporting.palette import KIND_COLORS, color_bytes
from gmmjax.reporting.splats import thinned
from gmmjax.transport import TransportResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's colours, without the black of the ellipses and the yellow that paper swallows.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
MARKERS = ("o", "s", "^", "D", "v", "P")
INK = "#1b1f24"
# What a mixture in 2-D is drawn on.
PLANE = Projection(np.eye(3)[0], np.eye(3)[1], np.eye(3)[2], ("x", "y"))


def plot_mixture(
    mixture: GaussianMixture,
    points: ArrayLike | PointCloud | None = None,
    *,
    direction: Direction = "oblique",
    deviations: float = 2.0,
    numbers: bool = True,
    unit: str | None = None,
    ax: "Axes | None" = None,
    settings: CloudImageSettings = CloudImageSettings(),
) -> "Axes":
    """Draws the Gaussians of a mixture as ellipses, over the points that it was fitted to.

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
        settings: how the points are drawn.

    Returns:
        The axes.

    Raises:
        InputError: matplotlib is not installed; a mixture of another dimension than 2 and 3, or without any component;
            points of another dimension.
    """
    ax = axes_or_new(ax, (7.0, 6.0))
    live = _live(mixture, "mixture")
    coordinates = _points_of(points, mixture.dimension)
    seen = live.in_space() if coordinates is None else _in_space(coordinates)
    projection = Projection.of(direction, seen) if mixture.dimension == 3 else PLANE
    page = Page.around(projection, seen, live.reach(projection, deviations), settings)
    if coordinates is not None:
        rows = thinned(np.arange(len(coordinates)), settings.most_points // 4)
        labels = np.asarray(mixture.labels(coordinates[rows]))
        colors = flat_colors([_paler(COLORS[slot % len(COLORS)]) for slot in range(len(mixture.live))], labels)
        page.draw(cloud_picture(seen[rows], colors, page, settings), ax, 1)
    for slot, mean, covariance in live.on_page(projection):
        ax.add_patch(_ellipse(mean, covariance, deviations, COLORS[slot % len(COLORS)]))
        if numbers:
            ax.annotate(str(slot), tuple(mean), ha="center", va="center", fontsize="small", color=INK, zorder=5)
    page.dress(ax, unit)
    return ax


def plot_grid_search(search: GridSearch, *, criterion: Criterion = "mdl", ax: "Axes | None" = None) -> "Axes":
    """Draws the scores of a grid search over the number of components, a line for each covariance type.

    Args:
        search: its result.
        criterion: "mdl", "bic" or "aic"; the lowest score is marked.
        ax: where to draw; None: a new figure.

    Returns:
        The axes.

    Raises:
        InputError: matplotlib is not installed; an unknown criterion.
    """
    check_choice("criterion", criterion, CRITERIA)
    ax = axes_or_new(ax, (7.0, 4.5))
    scores = np.asarray(search.scores[criterion], float)
    for row, name in enumerate(search.covariance_types):
        style: Style = {"color": COLORS[row % len(COLORS)], "marker": MARKERS[row % len(MARKERS)]}
        # What failed is infinite: a gap in the line.
        ax.plot(search.components, np.where(np.isfinite(scores[row]), scores[row], np.nan), label=name, **style)
    if np.isfinite(scores).any():
        row, column = divmod(int(np.argmin(scores)), scores.shape[1])
        text = f"lowest: {search.components[column]}, {search.covariance_types[row]}"
        _mark(ax, float(search.components[column]), float(scores[row, column]), text)
    light_frame(ax)
    _whole_numbers(ax)
    ax.set_xlabel("number of Gaussians")
    ax.set_ylabel(f"{criterion.upper()} (nats)")
    ax.legend(title="covariances", fontsize="small")
    return ax


def plot_message_length(fits: Fit | Sequence[Fit], *, ax: "Axes | None" = None) -> "Axes":
    """Draws the message length of fits over their number of components; the shortest is marked.

    The line joins the shortest length of each number. Fits of one cloud can be compared: the restarts of
    `fit_restarts`, or fits that start from, or end with, different numbers of components.

    Args:
        fits: one `Fit` with a leading axis of restarts, or several; those that are not finite are left out.
        ax: where to draw; None: a new figure.

    Returns:
        The axes.

    Raises:
        InputError: matplotlib is not installed; no fit is finite.
    """
    ax = axes_or_new(ax, (7.0, 4.5))
    counts, lengths = _counts_and_lengths([fits] if isinstance(fits, Fit) else fits)
    if not len(counts):
        raise InputError("fits: none of them has a finite message length; there is nothing to draw")
    numbers = np.unique(counts)
    shortest = np.array([lengths[counts == number].min() for number in numbers])
    ax.plot(numbers, shortest, color=COLORS[0], linewidth=1.2, label="shortest")
    ax.plot(counts, lengths, "o", color=COLORS[0], alpha=0.45, markeredgewidth=0, label="each fit")
    best = int(lengths.argmin())
    _mark(ax, float(counts[best]), float(lengths[best]), f"shortest: {counts[best]} Gaussians")
    light_frame(ax)
    _whole_numbers(ax)
    ax.set_xlabel("number of Gaussians")
    ax.set_ylabel("message length (nats)")
    ax.legend(fontsize="small")
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
    """Draws a transport plan between two mixtures: the flow of mass from Gaussian to Gaussian.

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

    Returns:
        The axes.

    Raises:
        InputError: matplotlib is not installed; mixtures that cannot be drawn; a plan of other mixtures.
    """
    plan = np.asarray(result.plan, float)
    if plan.shape != (len(before.live), len(after.live)):
        raise InputError(
            f"result: has a plan of {list(plan.shape)}, the mixtures have {len(before.live)} and {len(after.live)} "
            "slots; give the result of these two"
        )
    ax = axes_or_new(ax, (7.0, 6.0))
    sides = _live(before, "before"), _live(after, "after")
    means = np.concatenate([side.in_space() for side in sides])
    projection = Projection.of(direction, means) if before.dimension == 3 else PLANE
    reach = np.concatenate([side.reach(projection, deviations) for side in sides])
    page = Page.around(projection, means, reach)
    for side, color in zip(sides, (KIND_COLORS["disappeared"], KIND_COLORS["moved"]), strict=True):
        for _, mean, covariance in side.on_page(projection):
            ax.add_patch(_ellipse(mean, covariance, deviations, color))
    _draw_flow(ax, plan, *(side.on_page(projection) for side in sides))
    page.dress(ax, unit)
    verbatim(ax.title).set_text(f"transport cost {float(result.cost):.3g}{f' {unit}' if unit else ''}")
    _transport_legend(ax)
    return ax


class _OnPage(NamedTuple):
    """A Gaussian on the page: its slot, mean and covariance."""

    slot: int
    mean: Float[np.ndarray, "2"]
    covariance: Float[np.ndarray, "2 2"]

    def has_inside(self, place: Float[np.ndarray, "2"]) -> bool:
        """Whether a place is within a standard deviation of the mean: mass that moves there stays where it is."""
        offset = place - self.mean
        return bool(offset @ np.linalg.lstsq(self.covariance, offset)[0] <= 1)


class _Live:
    """The live components of a mixture on the host, in 2-D or 3-D."""

    def __init__(self, mixture: GaussianMixture) -> None:
        live = np.flatnonzero(np.asarray(mixture.live))
        self.slots = live.tolist()
        self.means = np.asarray(mixture.means, float)[live]
        self.covariances = np.asarray(mixture.covariances, float)[live]

    def in_space(self) -> Float[np.ndarray, "k 3"]:
        """The means, in 3-D."""
        return _in_space(self.means)

    def on_page(self, projection: Projection) -> list[_OnPage]:
        """Slot, mean and covariance on the page of each component."""
        covariances = np.zeros((len(self.slots), 3, 3))
        dimension = self.means.shape[1]
        covariances[:, :dimension, :dimension] = self.covariances
        flat = projection.covariance_on_page(covariances)
        places = projection.on_page(self.in_space())
        return [_OnPage(*component) for component in zip(self.slots, places, flat, strict=True)]

    def reach(self, projection: Projection, deviations: float) -> Float[np.ndarray, "m 3"]:
        """Points that are as far on the page as the ellipses."""
        points = []
        for mean, (_, _, covariance) in zip(self.in_space(), self.on_page(projection), strict=True):
            width, height = deviations * np.sqrt(np.maximum(np.diag(covariance), 0))
            for across, upwards in ((width, 0), (-width, 0), (0, height), (0, -height)):
                points.append(mean + across * projection.right + upwards * projection.up)
        return np.array(points)


def _live(mixture: GaussianMixture, name: str) -> _Live:
    if np.asarray(mixture.means).ndim != 2:
        raise InputError(f"{name}: must be one mixture, not a batch of them; choose one, such as with best_fit")
    if mixture.dimension not in (2, 3):
        raise InputError(f"{name}: has {mixture.dimension} dimensions; only mixtures in 2-D and 3-D can be drawn")
    live = _Live(mixture)
    if not live.slots:
        raise InputError(f"{name}: has no live component; there is nothing to draw")
    return live


def _points_of(points: ArrayLike | PointCloud | None, dimension: int) -> np.ndarray | None:
    if points is None:
        return None
    given = points.points if isinstance(points, PointCloud) else points
    require_array(given, "points")
    coordinates = np.asarray(given, float)
    if coordinates.ndim != 2 or coordinates.shape[1] != dimension:
        raise InputError(f"points: must be [n, {dimension}], as the mixture is, not {list(coordinates.shape)}")
    if not len(coordinates) or not np.isfinite(coordinates).all():
        raise InputError("points: must be finite, and at least one; leave out the rows with NaN")
    return coordinates


def _in_space(points: np.ndarray) -> Float[np.ndarray, "n 3"]:
    """Points in 2-D on the plane z = 0."""
    return points if points.shape[1] == 3 else np.pad(points, ((0, 0), (0, 1)))


def _ellipse(mean: np.ndarray, covariance: np.ndarray, deviations: float, color: str) -> Any:
    from matplotlib.patches import Ellipse

    variances, axes = np.linalg.eigh(covariance)
    width, height = 2 * deviations * np.sqrt(np.maximum(variances[::-1], 0))
    angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    red, green, blue = (value / 255 for value in color_bytes(color))
    style: Style = {"facecolor": (red, green, blue, 0.12), "edgecolor": color, "linewidth": 1.4}
    return Ellipse((float(mean[0]), float(mean[1])), width, height, angle=angle, zorder=3, **style)


def _paler(color: str) -> str:
    """Half way to white: points under their ellipse."""
    return "#" + "".join(f"{(value + 255) // 2:02x}" for value in color_bytes(color))


def _counts_and_lengths(fits: Sequence[Fit]) -> tuple[np.ndarray, np.ndarray]:
    """Of all fits that are finite the number of components and the message length."""
    live = [np.asarray(fit.mixture.live) for fit in fits]
    counts = np.concatenate([np.atleast_1d(own.sum(axis=-1)) for own in live] or [np.zeros(0, int)])
    lengths = np.concatenate([np.atleast_1d(np.asarray(fit.message_length, float)) for fit in fits] or [np.zeros(0)])
    lost = [np.atleast_1d(np.asarray(failed(fit.result))) for fit in fits]
    usable = np.isfinite(lengths) & ~np.concatenate(lost or [np.zeros(0, bool)])
    return counts[usable], lengths[usable]


def _mark(ax: "Axes", across: float, upwards: float, text: str) -> None:
    """A ring around the lowest place, and text below it."""
    ring: Style = {"markerfacecolor": "none", "markeredgecolor": INK, "markeredgewidth": 1.6, "markersize": 13}
    ax.plot([across], [upwards], "o", zorder=6, **ring)
    ax.margins(y=0.18)
    style: Style = {"textcoords": "offset points", "fontsize": "small", "color": INK, "ha": "center", "va": "top"}
    ax.annotate(text, (across, upwards), xytext=(0, -11), **style)


def _whole_numbers(ax: "Axes") -> None:
    from matplotlib.ticker import MaxNLocator

    left, right = ax.get_xlim()
    ax.set_xlim(min(left, np.ceil(left) - 0.5), max(right, np.floor(right) + 0.5))
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    ax.ticklabel_format(axis="y", useOffset=False)


def _draw_flow(ax: "Axes", plan: np.ndarray, before: Sequence[_OnPage], after: Sequence[_OnPage]) -> None:
    """An arrow for each mass that moves; negligible ones of an entropic plan are left out."""
    from matplotlib.patches import FancyArrowPatch

    least, most = 0.002 * plan.sum(), plan.max()
    for source in before:
        for target in after:
            mass = plan[source.slot, target.slot]
            if mass <= least or source.has_inside(target.mean):
                continue
            width = 0.5 + 4.0 * mass / most
            style: Style = {"arrowstyle": "-|>", "mutation_scale": 8 + 2 * width, "shrinkA": 2, "shrinkB": 2}
            ends = tuple(source.mean), tuple(target.mean)
            ax.add_patch(FancyArrowPatch(*ends, linewidth=width, color="0.35", alpha=0.7, zorder=4, **style))


def _transport_legend(ax: "Axes") -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Patch(facecolor="none", edgecolor=KIND_COLORS["disappeared"], label="before"),
        Patch(facecolor="none", edgecolor=KIND_COLORS["moved"], label="after"),
        Line2D([], [], color="0.35", linewidth=2.5, label="flow of mass"),
    ]
    legend_below(ax, handles)
