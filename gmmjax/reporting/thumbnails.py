"""The thumbnails of a pair: small pictures of both clouds from one camera, for pages that list many pairs."""

import dataclasses
import io
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8

from gmmjax.changes import Changes
from gmmjax.clouds import PointCloud, atomic_write
from gmmjax.geometry import evenly_chosen
from gmmjax.pair import Pair, each
from gmmjax.reporting.camera import HALF_HEIGHT, PlotCamera, initial_camera
from gmmjax.reporting.framing import stretched
from gmmjax.reporting.palette import KIND_COLORS, color_bytes, greyed, luminance
from gmmjax.reporting.result_folder import check_lengths
from gmmjax.reporting.splats import Projected, depth_steps, enclosed, nearest_points, square_edge

BEFORE_THUMBNAIL = "before.png"
AFTER_THUMBNAIL = "after.png"


@dataclasses.dataclass(frozen=True)
class ThumbnailSettings:
    """How thumbnails are drawn.

    Attributes:
        width: pixels; pages show thumbnails at half their size, so that they are sharp on fine screens.
        height: pixels.
        most_unchanged: points that are drawn of a cloud, at most; with fewer, surfaces have holes, with more, drawing
            takes longer.
        most_changed: changed points that are drawn beside them, at most.
        framing_points: points of each cloud that the frame is made for; with far fewer, its edges are left to chance.
        covered: area of the squares of all unchanged points, in thumbnails: the fewer points there are, the larger are
            their squares. With less, surfaces have holes; with more, small things lose their outline.
        largest_square: pixels, edge of the square of an unchanged point, at most; a cloud of ten points is still seen
            to be points.
        gap: pixels, width of the gaps of surfaces that are closed; 0 leaves them, and dense clouds are speckled.
        changed_square: pixels, edge of the square of a changed point; below 4 a single one is easily missed.
        outline: pixels, by which the white square under that of a changed point is larger; without it, blue on a dark
            scan is easily missed.
        shading: how much darker pixels are the further they lie behind their neighbours: powers of e for an octave of
            depth. At 0 only colours tell objects apart.
        largest_step: octaves of depth beyond which a step shades no more; without it, every outline is black.
        tones: colours, or brightnesses of a cloud without colours, 1 to 125; more give smoother pictures and larger
            files.
        darkest: brightness of the lowest points of a cloud without colours, 0 to 255; a thumbnail has no background of
            its own, and must stand out from dark and light pages.
        lightest: brightness of the highest points, likewise.
        least_contrast: of brightness, 0 to 1; colours that differ by less tell nothing, and heights are shown instead.
    """

    width: int = 320
    height: int = 240
    most_unchanged: int = 16_000
    most_changed: int = 4_000
    framing_points: int = 2_000
    covered: float = 2.0
    largest_square: int = 6
    gap: int = 2
    changed_square: int = 6
    outline: int = 3
    shading: float = 14.0
    largest_step: float = 0.1
    tones: int = 32
    darkest: int = 108
    lightest: int = 188
    least_contrast: float = 0.05

    @property
    def shades(self) -> int:
        """Of every tone: a palette has 256 entries, of which five are for what is not a tone."""
        return (256 - 5) // self.tones

    def square(self, points: int) -> int:
        """Pixels, edge of the squares of a number of points."""
        return square_edge(points, self.covered * self.width * self.height, self.largest_square)


class _Side(NamedTuple):
    """The points of one cloud that are drawn, in the frame of the before cloud.

    Attributes:
        points: coordinates.
        labels: per point -1 or the index of its change.
        colors: per point; None where the scan has none that tell anything.
    """

    points: Float[np.ndarray, "n 3"]
    labels: Int[np.ndarray, " n"]
    colors: UInt8[np.ndarray, "n 3"] | None


class _View(NamedTuple):
    """From where both clouds are seen.

    Attributes:
        camera: the direction.
        centre: what is in the middle.
        distance: of the eye from it.
    """

    camera: PlotCamera
    centre: Float[np.ndarray, "3"]
    distance: float

    def project(self, points: Float[np.ndarray, "n 3"], settings: ThumbnailSettings) -> Projected:
        """Where the points are in the thumbnail."""
        across, upwards, towards_eye = ((points - self.centre) @ self.camera.axes.T).T
        depth = self.distance - towards_eye
        # Points behind the eye are not drawn; the limit keeps the scale of those beside it finite.
        scale = settings.height / (2 * HALF_HEIGHT) / np.maximum(depth, 0.02 * self.distance)
        return Projected(settings.width / 2 + scale * across, settings.height / 2 - scale * upwards, depth)


def write_thumbnails(
    folder: Path, clouds: Pair[PointCloud], changes: Changes, settings: ThumbnailSettings = ThumbnailSettings()
) -> None:
    """Writes `before.png` and `after.png`: both clouds from the same camera, without a background.

    Unchanged points have the scan's own colours, half way to grey, or without colours are lighter the higher they are.
    Changed points have the colour of their kind and a white outline, and are drawn larger and over everything else, so
    that a small change, or one behind a wall, is seen. Large clouds are thinned. The same input gives the same bytes.

    Args:
        folder: where to; it must be there.
        clouds: as they were given to the detection; the after cloud is shown registered.
        changes: what was found.
        settings: how they are drawn.

    Raises:
        InputError: clouds that are not those of the changes, or a folder that cannot be written.
    """
    for name, content in zip((BEFORE_THUMBNAIL, AFTER_THUMBNAIL), thumbnails(clouds, changes, settings), strict=True):
        with atomic_write(folder / name) as file:
            file.write(content)


def thumbnails(
    clouds: Pair[PointCloud], changes: Changes, settings: ThumbnailSettings = ThumbnailSettings()
) -> Pair[bytes]:
    """What `write_thumbnails` writes: a PNG file of each cloud.

    Args:
        clouds: as they were given to the detection; the after cloud is shown registered.
        changes: what was found.
        settings: how they are drawn.

    Raises:
        InputError: clouds that are not those of the changes.
    """
    check_lengths(clouds.before, clouds.after, changes)
    sides = _sides(clouds, changes, settings)
    view = _view(sides, changes, settings)
    return sides.map(lambda side: _png(side, view, changes, settings))


def _sides(clouds: Pair[PointCloud], changes: Changes, settings: ThumbnailSettings) -> Pair[_Side]:
    def side(cloud: PointCloud, labels: Int[np.ndarray, " n"]) -> _Side:
        unchanged, changed = np.flatnonzero(labels < 0), np.flatnonzero(labels >= 0)
        drawn = np.concatenate([thinned(unchanged, settings.most_unchanged), thinned(changed, settings.most_changed)])
        colors = None if cloud.colors is None else cloud.colors[drawn]
        tells = colors is not None and np.ptp(luminance(colors)) > settings.least_contrast
        return _Side(cloud.points[drawn], labels[drawn], colors if tells else None)

    sides = each(side, clouds, Pair(changes.labels_before, changes.labels_after))
    return Pair(sides.before, sides.after._replace(points=changes.registration.apply(sides.after.points)))


def thinned(rows: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " m"]:
    """At most this number of rows: one, at random, of each of as many equal parts; the same ones each time.

    Every n-th row would make a pattern of a scan whose points are in the order of a grid.
    """
    if len(rows) <= most:
        return rows
    places = np.arange(most) + np.random.default_rng(0).random(most)
    return rows[(places * (len(rows) / most)).astype(int)]


def _view(sides: Pair[_Side], changes: Changes, settings: ThumbnailSettings) -> _View:
    """As the report looks at first, with every change in the frame."""
    camera = initial_camera(sides.after.points)
    few = [side.points[evenly_chosen(len(side.points), settings.framing_points)] for side in sides]
    corners = [change.box.corners() for change in changes]
    # Survey coordinates are large: sums of squares are taken near the origin.
    origin = sides.before.points[0]
    centre, distance = camera.framed(
        np.concatenate([*few, *corners]) - origin,
        shown=np.concatenate([np.empty((0, 3)), *corners]) - origin,
        half_width=HALF_HEIGHT * settings.width / settings.height,
    )
    return _View(camera, origin + centre, distance)


def _png(side: _Side, view: _View, changes: Changes, settings: ThumbnailSettings) -> bytes:
    """One thumbnail: an image of palette indices, of which 0 is transparent, 1 the outline, and then come the kinds."""
    from PIL import Image

    special = [(0, 0, 0), (255, 255, 255), *(color_bytes(color) for color in KIND_COLORS.values())]
    projected = view.project(side.points, settings)
    unchanged = side.labels < 0
    palette, pixels = _unchanged_pixels(projected.chosen(unchanged), *_tones(side, view.camera, settings), settings)
    pixels = np.where(pixels < 0, 0, pixels + len(special))
    _draw_changed(pixels, projected.chosen(~unchanged), side.labels[~unchanged], changes, settings)
    image = Image.frombytes("P", (settings.width, settings.height), pixels.astype(np.uint8).tobytes())
    image.putpalette(np.concatenate([np.array(special, np.uint8), palette]).tobytes())
    content = io.BytesIO()
    image.save(content, "PNG", transparency=0)
    return content.getvalue()


def _tones(
    side: _Side, camera: PlotCamera, settings: ThumbnailSettings
) -> tuple[Int[np.ndarray, " n"], UInt8[np.ndarray, "t 3"]]:
    """The tone of each unchanged point, and the tones: from dark to light by height, or the colours of the scan."""
    from PIL import Image

    unchanged = side.labels < 0
    if side.colors is None or not unchanged.any():
        heights = stretched(side.points[unchanged] @ camera.up)
        greys = np.linspace(settings.darkest, settings.lightest, settings.tones)
        return np.rint(heights * (settings.tones - 1)).astype(int), np.tile(greys[:, None], 3).astype(np.uint8)
    colors = Image.fromarray(greyed(side.colors[unchanged])[None])
    # Octrees keep the few colours of small things, which the median cut, by number of points, merges.
    quantized = colors.quantize(settings.tones, Image.Quantize.FASTOCTREE)
    palette = np.array(quantized.getpalette(), np.uint8).reshape(-1, 3)
    return np.asarray(quantized)[0].astype(int), palette[: settings.tones]


def _unchanged_pixels(
    points: Projected,
    tone: Int[np.ndarray, " n"],
    tones: UInt8[np.ndarray, "t 3"],
    settings: ThumbnailSettings,
) -> tuple[UInt8[np.ndarray, "c 3"], Int[np.ndarray, "h w"]]:
    """A palette of every tone in every shade, and the index into it of each pixel, -1 where there is no point."""
    square = settings.square(len(points.depth))
    nearest = nearest_points(points, square, settings.height, settings.width)
    wider = nearest_points(points, square + settings.gap, settings.height, settings.width)
    nearest = np.where(enclosed(nearest >= 0, settings.gap), wider, nearest)
    covered = nearest >= 0
    depth = np.full(nearest.shape, np.inf, np.float32)
    depth[covered] = points.depth[nearest[covered]]
    steps = depth_steps(depth, settings.largest_step)[covered] / settings.largest_step
    shade = np.rint(steps * (settings.shades - 1)).astype(int)
    pixels = np.full(nearest.shape, -1)
    pixels[covered] = tone[nearest[covered]] * settings.shades + shade
    brightness = np.exp(-settings.shading * settings.largest_step * np.linspace(0, 1, settings.shades))
    return np.rint(tones[:, None] * brightness[:, None]).astype(np.uint8).reshape(-1, 3), pixels


def _draw_changed(
    pixels: Int[np.ndarray, "h w"],
    points: Projected,
    labels: Int[np.ndarray, " n"],
    changes: Changes,
    settings: ThumbnailSettings,
) -> None:
    """Over everything else, whatever is in front of it."""
    square, size = settings.changed_square, (settings.height, settings.width)
    outlined = nearest_points(points, square + settings.outline, *size) >= 0
    nearest = nearest_points(points, square, *size)
    kinds = list(KIND_COLORS)
    entries = np.array([2 + kinds.index(change.kind) for change in changes], int)
    pixels[outlined] = 1
    pixels[nearest >= 0] = entries[labels[nearest[nearest >= 0]]]
