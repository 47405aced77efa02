"""Clouds as pictures of pixels for plots: nearest points in front, surfaces closed and shaded.

A scan of a million points is a picture of some hundred kilobytes, in a PDF too, where a million markers would be a file
that no viewer opens; and a surface of points is recognised by the shading of its edges.
"""

import dataclasses
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import uniform_filter

from gmmjax.plotting.figures import draw_scale, verbatim, with_unit
from gmmjax.plotting.projection import Projection
from gmmjax.reporting.framing import stretched
from gmmjax.reporting.palette import color_bytes, greyed, luminance
from gmmjax.reporting.splats import Projected, enclosed, nearest_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclasses.dataclass(frozen=True)
class CloudImageSettings:
    """How clouds are drawn.

    Attributes:
        pixels: of the longer edge of the picture.
        most_points: that are drawn of what is unchanged, at most, and of what is changed; with more, drawing takes
            longer and looks the same.
        covered: area of the squares of all points, in pictures: the fewer points there are, the larger are their
            squares. With less, surfaces have holes; with more, small things lose their outline.
        largest_square: pixels, edge of the square of a point, at most; a cloud of ten points is still seen to be
            points.
        gap: pixels, width of the gaps of surfaces that are closed; 0 leaves them, and dense clouds are speckled.
        stray_share: share of a cloud's points on each side of the page that may lie outside of the picture; at 0 one
            stray point far out makes all else tiny.
        margin: of the picture around the points, as a share of its size.
        shading: how much darker pixels are the further they lie behind their neighbours: powers of e for a hundredth of
            the picture. At 0 only colours tell objects apart.
        largest_step: hundredths of the picture beyond which a step shades no more; without it, every outline is black.
        pale: opacity of what is unchanged where both clouds are drawn; at 1 the changes stand out less.
        layers: depth of a place on the page, as a share of the whole depth, from which on something is behind something
            else there, such as a floor behind a ceiling. Above 1 there never is.
        least_layer: the same, at least, as a share of the picture; at 0 the noise of a floor is layers.
        layered_share: share of such places from which on a cloud is drawn as if by X-rays, dark where many points are
            behind each other, so that a ceiling or a wall in front hides nothing. Above 1 it never is.
        cells: of the grid that is looked through for them, along the longer edge of the picture, at most.
        points_per_cell: of a sparse cloud, for which the grid is coarser; with few, nothing is behind anything.
        darkest: brightness of the lowest points of a cloud without colours, 0 to 255.
        lightest: brightness of the highest points, likewise; near 255 they vanish on white paper.
        least_contrast: of brightness, 0 to 1; colours that differ by less tell nothing, and heights are shown instead.
        outline: pixels, width of the white line around what is changed; without it, blue on a dark scan is missed.
        least_changed: pixels, edge of the square of a changed point, at least; below 4 a single one is easily missed.
    """

    pixels: int = 900
    most_points: int = 400_000
    covered: float = 5.0
    largest_square: int = 7
    gap: int = 4
    stray_share: float = 0.0005
    margin: float = 0.03
    shading: float = 0.6
    largest_step: float = 1.0
    pale: float = 0.6
    layers: float = 0.6
    least_layer: float = 0.03
    layered_share: float = 0.35
    cells: int = 60
    points_per_cell: int = 16
    darkest: int = 130
    lightest: int = 205
    least_contrast: float = 0.05
    outline: int = 4
    least_changed: int = 4


class Page(NamedTuple):
    """The part of the page that a picture shows.

    Attributes:
        projection: from where.
        lower: left and lower edge, in the unit of the clouds.
        upper: right and upper edge.
        height: of the picture, pixels.
        width: likewise.
    """

    projection: Projection
    lower: Float[np.ndarray, "2"]
    upper: Float[np.ndarray, "2"]
    height: int
    width: int

    @classmethod
    def around(
        cls,
        projection: Projection,
        points: Float[np.ndarray, "n 3"],
        shown: Float[np.ndarray, "m 3"],
        settings: CloudImageSettings = CloudImageSettings(),
    ) -> "Page":
        """The page that holds all points but strays.

        Args:
            projection: from where.
            points: of all clouds that are drawn.
            shown: points that must be on the page.
            settings: how much is left out.
        """
        seen = projection.on_page(points)
        strays = settings.stray_share
        inner = np.quantile(seen, [strays, 1 - strays], axis=0)
        bounds = np.concatenate([inner, projection.on_page(shown)])
        lower, upper = bounds.min(axis=0), bounds.max(axis=0)
        # A single point, too, has a page around it that float64 can tell from a point.
        least = 1e-12 * float(np.abs(bounds).max()) + float(np.finfo(np.float32).tiny)
        pad = max(settings.margin * float((upper - lower).max()), least)
        lower, upper = lower - pad, upper + pad
        # A line of points still has a picture with some height.
        thin = np.maximum(0.15 * (upper - lower).max() - (upper - lower), 0) / 2
        lower, upper = lower - thin, upper + thin
        width, height = np.maximum(np.rint(settings.pixels * (upper - lower) / (upper - lower).max()), 1).astype(int)
        return cls(projection, lower, upper, int(height), int(width))

    @property
    def scale(self) -> float:
        """Pixels for each unit of length."""
        return self.width / float(self.upper[0] - self.lower[0])

    def project(self, points: Float[np.ndarray, "n 3"]) -> Projected:
        """Where points are in the picture, pixels; depths too, from a plane in front of them all."""
        column, row = ((self.projection.on_page(points) - self.lower) * self.scale).T
        nearness = points @ self.projection.towards_eye * self.scale
        front = float(nearness.max(initial=-np.inf))
        return Projected(column, self.height - row, (front if len(points) else 0.0) - nearness + 1.0)

    def draw(self, picture: UInt8[np.ndarray, "h w 4"], ax: "Axes", layer: int, opacity: float = 1.0) -> None:
        """Draws a picture of this page in the unit of the clouds."""
        extent = (self.lower[0], self.upper[0], self.lower[1], self.upper[1])
        ax.imshow(picture, extent=extent, interpolation="antialiased", aspect="equal", zorder=layer, alpha=opacity)

    def dress(self, ax: "Axes", unit: str | None) -> None:
        """Equal axes with their names; of an oblique view, which is along no axis, a bar that shows the scale.

        Args:
            ax: that the picture is drawn into.
            unit: of lengths; None: not known.
        """
        ax.set_aspect("equal")
        ax.set_xlim(self.lower[0], self.upper[0])
        ax.set_ylim(self.lower[1], self.upper[1])
        if self.projection.names is None:
            ax.set(xticks=[], yticks=[])
            ax.spines[:].set_visible(False)
            draw_scale(ax, self.lower, self.upper, unit)
            return
        for name, label in zip(self.projection.names, (ax.xaxis.label, ax.yaxis.label), strict=True):
            verbatim(label).set_text(with_unit(name, unit))


def cloud_picture(
    points: Float[np.ndarray, "n 3"],
    colors: UInt8[np.ndarray, "n 3"],
    page: Page,
    settings: CloudImageSettings = CloudImageSettings(),
) -> UInt8[np.ndarray, "h w 4"]:
    """Points in their colours, transparent where there is none; darker the further behind their surroundings.

    Args:
        points: of the cloud.
        colors: of each point.
        page: what of it is shown.
        settings: how it is drawn.
    """
    projected = page.project(points)
    square = _square(len(points), page, settings)
    nearest = nearest_points(projected, square, page.height, page.width)
    wider = nearest_points(projected, square + settings.gap, page.height, page.width)
    nearest = np.where(enclosed(nearest >= 0, settings.gap), wider, nearest)
    covered = nearest >= 0
    picture = np.zeros((page.height, page.width, 4), np.uint8)
    picture[covered, :3] = colors[nearest[covered]] * _brightness(projected, nearest, settings)[covered, None]
    picture[covered, 3] = 255
    return picture


def is_layered(
    points: Float[np.ndarray, "n 3"], page: Page, settings: CloudImageSettings = CloudImageSettings()
) -> bool:
    """Whether in much of the picture something is behind something else, as a floor is behind a ceiling.

    Args:
        points: of the cloud.
        page: what of it is shown.
        settings: what is much.
    """
    cells = int(np.clip(np.sqrt(len(points) / settings.points_per_cell), 1, settings.cells))
    projected, size = page.project(points), max(page.height, page.width) / cells
    inside = (projected.column >= 0) & (projected.column < page.width)
    inside &= (projected.row >= 0) & (projected.row < page.height)
    if not inside.any():
        return False
    depth = projected.depth[inside]
    cell = (projected.row[inside] // size * cells + projected.column[inside] // size).astype(int)
    order = np.lexsort((depth, cell))
    cell, depth = cell[order], depth[order]
    starts = np.flatnonzero(np.diff(cell, prepend=-1))
    spans = depth[np.append(starts[1:], len(depth)) - 1] - depth[starts]
    lowest, highest = np.quantile(depth, [0.01, 0.99])
    behind = max(settings.layers * (highest - lowest), settings.least_layer * max(page.height, page.width))
    return bool((spans > behind).mean() > settings.layered_share)


def density_picture(
    points: Float[np.ndarray, "n 3"], page: Page, settings: CloudImageSettings = CloudImageSettings()
) -> UInt8[np.ndarray, "h w 4"]:
    """Points as if seen by X-rays: the darker, the more of them are behind each other.

    Args:
        points: of the cloud.
        page: what of it is shown.
        settings: how it is drawn.
    """
    square, projected = _square(len(points), page, settings), page.project(points)
    column, row = (np.floor(place).astype(int) for place in (projected.column, projected.row))
    inside = (column >= 0) & (column < page.width) & (row >= 0) & (row < page.height)
    counts = np.bincount(row[inside] * page.width + column[inside], minlength=page.height * page.width)
    spread = uniform_filter(counts.reshape(page.height, page.width).astype(float), square, mode="constant")
    covered = spread > 1e-9
    darkness = stretched(np.log1p(spread[covered] * square**2))
    picture = np.zeros((page.height, page.width, 4), np.uint8)
    picture[covered, :3] = np.rint(235 - (235 - settings.darkest / 2) * darkness)[:, None]
    picture[covered, 3] = 255
    return picture


def marked_picture(
    points: Float[np.ndarray, "n 3"],
    colors: UInt8[np.ndarray, "n 3"],
    page: Page,
    settings: CloudImageSettings = CloudImageSettings(),
    others: int = 0,
) -> UInt8[np.ndarray, "h w 4"]:
    """Points in flat colours with a white outline, to be drawn over a cloud.

    Args:
        points: of the cloud.
        colors: of each point.
        page: what of it is shown.
        settings: how it is drawn.
        others: points of the same cloud that are not drawn: the squares are as large as with them.
    """
    projected = page.project(points)
    square = max(_square(len(points) + others, page, settings), settings.least_changed)
    size = page.height, page.width
    nearest = nearest_points(projected, square, *size)
    picture = np.zeros((*size, 4), np.uint8)
    picture[nearest_points(projected, square + settings.outline, *size) >= 0] = 255
    picture[nearest >= 0, :3] = colors[nearest[nearest >= 0]]
    return picture


def scan_colors(
    points: Float[np.ndarray, "n 3"],
    colors: UInt8[np.ndarray, "n 3"] | None,
    up: Float[np.ndarray, "3"],
    settings: CloudImageSettings = CloudImageSettings(),
) -> UInt8[np.ndarray, "n 3"]:
    """A scan's own colours, half way to grey; of one without colours that tell anything greys, the lighter the higher.

    Args:
        points: of the scan.
        colors: its own; None: it has none.
        up: what is up.
        settings: which greys.
    """
    if colors is not None and len(colors) and np.ptp(luminance(colors)) > settings.least_contrast:
        return greyed(colors)
    heights = stretched(points @ up)
    greys = settings.darkest + (settings.lightest - settings.darkest) * heights
    return np.repeat(np.rint(greys).astype(np.uint8)[:, None], 3, axis=1)


def flat_colors(names: list[str], numbers: Int[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """The colour of each point, given by its place among some colours.

    Args:
        names: colours, "#rrggbb".
        numbers: of each point the place of its colour.
    """
    return np.array([color_bytes(name) for name in names], np.uint8).reshape(-1, 3)[numbers]


def _square(points: int, page: Page, settings: CloudImageSettings) -> int:
    edge = np.sqrt(settings.covered * page.width * page.height / max(points, 1))
    return int(np.clip(round(edge), 1, settings.largest_square))


def _brightness(
    projected: Projected, nearest: Int[np.ndarray, "h w"], settings: CloudImageSettings
) -> Float[np.ndarray, "h w"]:
    """Eye-dome lighting as of the thumbnails, for a parallel projection: by differences of depth, not by octaves."""
    covered: Bool[np.ndarray, "h w"] = nearest >= 0
    depth = np.full(nearest.shape, 1e9)
    depth[covered] = projected.depth[nearest[covered]] * 100 / settings.pixels
    padded = np.pad(depth, 1, constant_values=1e9)
    neighbours = padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]
    steps = sum(np.clip(depth - neighbour, 0, settings.largest_step) for neighbour in neighbours) / 4
    brightness: Float[np.ndarray, "h w"] = np.exp(-settings.shading * steps)
    return brightness
