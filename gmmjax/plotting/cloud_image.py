"""Clouds as pictures of pixels for plots: nearest points in front, surfaces closed and shaded.

A scan of a million points is a picture of some hundred kilobytes, in a PDF too, where a million markers would be a file
that no viewer opens; and a surface of points is recognised by the shading of its edges.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.ndimage import uniform_filter

from gmmjax.plotting.axes import draw_scale, verbatim, with_unit
from gmmjax.plotting.projection import Projection
from gmmjax.reporting.palette import color_bytes, greyed, luminance, stretched
from gmmjax.reporting.splats import Projected, enclosed, nearest_points, square_edge

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Pixels of the longer edge of a picture.
PIXELS = 900
# Points that are drawn of what is unchanged, at most, and of what is changed: with more it looks the same.
MAX_POINTS = 400_000
# Area of the squares of all points, in pictures, and pixels of the edge of one at most: with less, surfaces have holes.
COVERED, LARGEST_SQUARE = 5.0, 7
# Pixels: width of the gaps of surfaces that are closed, edge of the square of a changed point at least, and width of
# the white line around it, without which blue on a dark scan is missed.
GAP, MIN_CHANGED, OUTLINE = 4, 4, 4
# Share of a cloud's points on each side of the page that may lie outside of the picture, and its margin around the
# others: at 0 one stray point far out makes all else tiny.
STRAYS, MARGIN = 0.0005, 0.03
# Pixels are darker the further they lie behind their neighbours: powers of e for a hundredth of the picture, up to one.
SHADING = 0.6
# Greys of the lowest and the highest points of a cloud without colours; lighter ones vanish on white paper.
DARKEST, LIGHTEST = 130, 205
# Brightness, 0 to 1: colours that differ by less tell nothing, and heights are shown instead.
MIN_CONTRAST = 0.05
# A cloud is drawn as if by X-rays where in more than a third of the picture something is behind something else, such as
# a floor behind a ceiling: by this share of the whole depth, and of the picture, which the noise of a floor is not.
LAYERED, LAYERS, MIN_LAYER = 0.35, 0.6, 0.03


class Page(NamedTuple):
    """The part of the page that a picture shows: lower left and upper right corner; height and width in pixels."""

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
        pixels: int = PIXELS,
    ) -> "Page":
        """Return the page that holds all points but strays, and the `shown` ones; `pixels` long."""
        inner = np.quantile(projection.on_page(points), [STRAYS, 1 - STRAYS], axis=0)
        bounds = np.concatenate([inner, projection.on_page(shown)])
        lower, upper = bounds.min(axis=0), bounds.max(axis=0)
        # A single point, too, has a page around it that float64 can tell from a point.
        least = 1e-12 * float(np.abs(bounds).max()) + float(np.finfo(np.float32).tiny)
        pad = max(MARGIN * float((upper - lower).max()), least)
        lower, upper = lower - pad, upper + pad
        # A line of points still has a picture with some height.
        thin = np.maximum(0.15 * (upper - lower).max() - (upper - lower), 0) / 2
        lower, upper = lower - thin, upper + thin
        width, height = np.maximum(np.rint(pixels * (upper - lower) / (upper - lower).max()), 1).astype(int)
        return cls(projection, lower, upper, int(height), int(width))

    @property
    def scale(self) -> float:
        """Pixels for each unit of length."""
        return self.width / float(self.upper[0] - self.lower[0])

    def project(self, points: Float[np.ndarray, "n 3"]) -> Projected:
        """Project points into the picture, pixels; depths too, from a plane in front of them all."""
        column, row = ((self.projection.on_page(points) - self.lower) * self.scale).T
        nearness = points @ self.projection.towards_eye * self.scale
        front = float(nearness.max(initial=-np.inf))
        return Projected(column, self.height - row, (front if len(points) else 0.0) - nearness + 1.0)

    def square(self, points: int) -> int:
        """Return the edge of the squares of a number of points, pixels: the fewer there are, the larger."""
        return square_edge(points, COVERED * self.width * self.height, LARGEST_SQUARE)

    def draw(self, picture: UInt8[np.ndarray, "h w 4"], ax: "Axes", layer: int, opacity: float = 1.0) -> None:
        """Draw a picture of this page in the unit of the clouds."""
        extent = (self.lower[0], self.upper[0], self.lower[1], self.upper[1])
        ax.imshow(picture, extent=extent, interpolation="antialiased", aspect="equal", zorder=layer, alpha=opacity)

    def draw_scan(
        self, points: Float[np.ndarray, "n 3"], colors: UInt8[np.ndarray, "n 3"], ax: "Axes", opacity: float = 1.0
    ) -> None:
        """Draw a scan below all else: a picture of its points or, along an axis of what has layers, as if by X-rays."""
        if self.projection.names is not None and is_layered(points, self):
            self.draw(density_picture(points, self), ax, 1)
        else:
            self.draw(cloud_picture(points, colors, self), ax, 1, opacity)

    def dress(self, ax: "Axes", unit: str | None) -> None:
        """Name equal axes; of an oblique view, which is along no axis, draw a bar that shows the scale."""
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
    points: Float[np.ndarray, "n 3"], colors: UInt8[np.ndarray, "n 3"], page: Page
) -> UInt8[np.ndarray, "h w 4"]:
    """Draw points in their colours, transparent where there is none; darker the further behind their surroundings."""
    projected, square = page.project(points), page.square(len(points))
    nearest = nearest_points(projected, square, page.height, page.width)
    wider = nearest_points(projected, square + GAP, page.height, page.width)
    nearest = np.where(enclosed(nearest >= 0, GAP), wider, nearest)
    covered = nearest >= 0
    picture = np.zeros((page.height, page.width, 4), np.uint8)
    picture[covered, :3] = colors[nearest[covered]] * _brightness(projected, nearest)[covered, None]
    picture[covered, 3] = 255
    return picture


def is_layered(points: Float[np.ndarray, "n 3"], page: Page) -> bool:
    """Tell whether in much of the picture something is behind something else, as a floor is behind a ceiling."""
    # Of sparse clouds a coarser grid, with some points in each cell.
    cells = int(np.clip(np.sqrt(len(points) / 16), 1, 60))
    projected, size = page.project(points), max(page.height, page.width) / cells
    inside = (projected.column >= 0) & (projected.column < page.width)
    inside &= (projected.row >= 0) & (projected.row < page.height)
    if not inside.any():
        return False
    column, row, depth = projected.chosen(inside)
    cell = (row // size * cells + column // size).astype(int)
    order = np.lexsort((depth, cell))
    cell, depth = cell[order], depth[order]
    starts = np.flatnonzero(np.diff(cell, prepend=-1))
    spans = depth[np.append(starts[1:], len(depth)) - 1] - depth[starts]
    lowest, highest = np.quantile(depth, [0.01, 0.99])
    behind = max(LAYERS * (highest - lowest), MIN_LAYER * max(page.height, page.width))
    return bool((spans > behind).mean() > LAYERED)


def density_picture(points: Float[np.ndarray, "n 3"], page: Page) -> UInt8[np.ndarray, "h w 4"]:
    """Draw points as if seen by X-rays: the darker, the more of them are behind each other."""
    square, projected = page.square(len(points)), page.project(points)
    counts, _, _ = np.histogram2d(
        projected.row, projected.column, bins=(page.height, page.width), range=((0, page.height), (0, page.width))
    )
    spread = uniform_filter(counts, square, mode="constant")
    covered = spread > 1e-9
    darkness = stretched(np.log1p(spread[covered] * square**2))
    picture = np.zeros((page.height, page.width, 4), np.uint8)
    picture[covered, :3] = np.rint(235 - (235 - DARKEST / 2) * darkness)[:, None]
    picture[covered, 3] = 255
    return picture


def marked_picture(
    points: Float[np.ndarray, "n 3"], colors: UInt8[np.ndarray, "n 3"], page: Page, others: int = 0
) -> UInt8[np.ndarray, "h w 4"]:
    """Draw points in flat colours with a white outline; squares are as large as with `others` of the same cloud."""
    projected, size = page.project(points), (page.height, page.width)
    square = max(page.square(len(points) + others), MIN_CHANGED)
    nearest = nearest_points(projected, square, *size)
    picture = np.zeros((*size, 4), np.uint8)
    picture[nearest_points(projected, square + OUTLINE, *size) >= 0] = 255
    picture[nearest >= 0, :3] = colors[nearest[nearest >= 0]]
    return picture


def scan_colors(
    points: Float[np.ndarray, "n 3"], colors: UInt8[np.ndarray, "n 3"] | None, up: Float[np.ndarray, "3"]
) -> UInt8[np.ndarray, "n 3"]:
    """Return a scan's own colours, half way to grey; without colours that tell anything greys, lighter the higher."""
    if colors is not None and len(colors) and np.ptp(luminance(colors)) > MIN_CONTRAST:
        return greyed(colors)
    greys = DARKEST + (LIGHTEST - DARKEST) * stretched(points @ up)
    return np.repeat(np.rint(greys).astype(np.uint8)[:, None], 3, axis=1)


def flat_colors(names: list[str], numbers: Int[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Return the colour of each point, given by its place among some colours "#rrggbb"."""
    return np.array([color_bytes(name) for name in names], np.uint8).reshape(-1, 3)[numbers]


def _brightness(projected: Projected, nearest: Int[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Shade as the thumbnails, for a parallel projection: by differences of depth, not by octaves."""
    covered = nearest >= 0
    depth = np.full(nearest.shape, 1e9)
    depth[covered] = projected.depth[nearest[covered]] * 100 / max(nearest.shape)
    padded = np.pad(depth, 1, constant_values=1e9)
    neighbours = padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:]
    steps = sum(np.clip(depth - neighbour, 0, 1) for neighbour in neighbours) / 4
    return np.asarray(np.exp(-SHADING * steps))
