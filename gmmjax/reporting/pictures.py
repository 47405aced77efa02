"""Pictures of a pair, made without WebGL: close-ups of each change, both clouds as a whole, thumbnails for lists."""

import base64
import dataclasses
import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import binary_closing, binary_dilation, binary_fill_holes, distance_transform_edt

from gmmjax.changes import NAMES, Changes, Kind, presented
from gmmjax.clouds import PointCloud, atomic_write
from gmmjax.geometry import evenly_chosen
from gmmjax.pair import Pair, each
from gmmjax.reporting.camera import HALF_HEIGHT, PlotCamera, initial_camera
from gmmjax.reporting.palette import KIND_COLORS, color_bytes, luminance, stretched
from gmmjax.reporting.splats import Projected, depth_steps, enclosed, nearest_points, square_edge, thinned

# Points of each cloud that the camera is chosen by: enough to see a post in front of the change.
JUDGED_POINTS = 4_000
# Half the width of a close-up, in radii of the change: enough of its surroundings to see where it is.
SURROUNDINGS = 2.0
# Half the width of the gaps of surfaces that are closed, pixels: without, surfaces near the eye are speckled.
GAP = 10
OUTLINE = 2


@dataclasses.dataclass(frozen=True)
class PictureSettings:
    """Size of the pictures.

    Attributes:
        width: pixels; pages show pictures at half their size, so that they are sharp on fine screens.
        height: pixels.
        max_points: of each cloud that are drawn; with fewer, surfaces have holes, with more, drawing takes longer.
    """

    width: int = 360
    height: int = 270
    max_points: int = 80_000

    def square(self, points: int) -> int:
        """Return the edge of the square of a point, pixels: together they cover the picture two and a half times."""
        return square_edge(points, 2.5 * self.width * self.height, largest=9)


THUMBNAIL = PictureSettings(width=320, height=240, max_points=16_000)


class _Side(NamedTuple):
    """Points of one cloud in the frame of the before cloud, their colours or greys, and places of the sensor."""

    points: Float[np.ndarray, "n 3"]
    colors: UInt8[np.ndarray, "n 3"]
    labels: Int[np.ndarray, " n"]
    sensors: Float[np.ndarray, "v 3"]

    def chosen(self, rows: Int[np.ndarray, " m"]) -> "_Side":
        """Return some of the points."""
        return _Side(self.points[rows], self.colors[rows], self.labels[rows], self.sensors)

    def thinned(self, changed: Bool[np.ndarray, " n"], most: int) -> "_Side":
        """Keep at most this number of the changed points, and of the others."""
        return self.chosen(np.concatenate([thinned(np.flatnonzero(own), most) for own in (changed, ~changed)]))


class _Target(NamedTuple):
    """The changes that a close-up is of, all of one kind.

    Attributes:
        points: some of theirs, relative to the centre, without those that lie far out.
        radius: of the sphere about the centre that holds these points.
    """

    labels: tuple[int, ...]
    kind: Kind
    centre: Float[np.ndarray, "3"]
    points: Float[np.ndarray, "n 3"]
    radius: float

    @classmethod
    def of(cls, changes: Changes, labels: tuple[int, ...], points: Float[np.ndarray, "n 3"]) -> "_Target":
        """Gather changes with points of theirs in both clouds; without, as of a record made by hand, by their boxes."""
        if not len(points):
            points = np.concatenate([changes[label].box.corners() for label in labels])
        lower, upper = np.quantile(points, [0.02, 0.98], axis=0)
        centre = (lower + upper) / 2
        distances = np.linalg.norm(points - centre, axis=1)
        inner = distances <= np.quantile(distances, 0.98)
        # A change of a single point has no size, and still has surroundings.
        least = 1e-9 * float(np.abs(centre).max()) + float(np.finfo(np.float32).tiny)
        radius = max(float(distances[inner].max()), least)
        return cls(labels, changes[labels[0]].kind, centre, (points - centre)[inner], radius)

    def among(self, side: _Side) -> Bool[np.ndarray, " n"]:
        """Tell which points of a cloud are its own."""
        return np.isin(side.labels, self.labels)


class Pictures:
    """The pictures of a pair of clouds, as WebP files without a background.

    Attributes:
        directions: of the close-ups made so far, by the label of each change: the unit vector towards the eye.
    """

    def __init__(
        self, clouds: Pair[PointCloud], changes: Changes, settings: PictureSettings = PictureSettings()
    ) -> None:
        """Prepare the clouds that the changes were found in, the after cloud as given."""
        self._changes, self._settings = changes, settings
        self.directions: dict[int, np.ndarray] = {}
        self._camera = initial_camera(changes.registration.apply(clouds.after.points))
        labels = Pair(changes.labels_before, changes.labels_after)
        self._sides = each(self._side, clouds, labels, Pair(False, True))

    def close_ups(self, labels: tuple[int, ...]) -> Pair[bytes]:
        """Draw one object, given by its labels, before and after, from one camera, its points tinted and outlined."""
        own = [np.flatnonzero(np.isin(side.labels, labels)) for side in self._sides]
        few = [side.points[thinned(rows, JUDGED_POINTS)] for side, rows in zip(self._sides, own, strict=True)]
        target = _Target.of(self._changes, labels, np.concatenate(few))
        near = self._sides.map(lambda side: _around(side, target))
        judged = near.map(lambda side: side.thinned(target.among(side), JUDGED_POINTS))
        camera = _chosen_camera(judged, target, self._camera)
        self.directions |= dict.fromkeys(labels, camera.towards_eye)
        distance = SURROUNDINGS * target.radius / HALF_HEIGHT
        near = near.map(lambda side: _visible(side, target, camera, distance, self._settings))
        views = near.map(lambda side: _seen(side.points, camera, target.centre, distance, self._settings))
        drawn = each(lambda side, view: _drawn(side, view, target, self._settings), near, views)
        # Where the change was or will be is outlined in either picture.
        outline = _outline(drawn.before[1] | drawn.after[1])
        for pixels, _ in drawn:
            pixels[outline] = *color_bytes(KIND_COLORS[target.kind]), 255
        return drawn.map(lambda one: _webp(one[0]))

    def overview(self) -> Pair[bytes]:
        """Draw both clouds as a whole, from one camera.

        Changed points have the colour of their kind and a white outline, and are drawn over everything else, so that a
        small change, or one behind a wall, is seen.
        """
        settings = self._settings
        few = self._sides.map(lambda side: side.thinned(side.labels >= 0, settings.max_points))
        # Survey coordinates are large: sums of squares are taken near the origin.
        origin = few.before.points[0]
        corners = np.concatenate([np.empty((0, 3)), *(change.box.corners() for change in self._changes)]) - origin
        framed = np.concatenate([side.points[evenly_chosen(len(side.points), 2_000)] - origin for side in few])
        half_width = HALF_HEIGHT * settings.width / settings.height
        centre, distance = self._camera.framed(np.concatenate([framed, corners]), corners, half_width)
        return few.map(lambda side: _webp(self._overview(side, origin + centre, distance)))

    def _overview(self, side: _Side, centre: Float[np.ndarray, "3"], distance: float) -> UInt8[np.ndarray, "h w 4"]:
        size = self._settings.height, self._settings.width
        view = _seen(side.points, self._camera, centre, distance, self._settings)
        changed = side.labels >= 0
        pixels = _drawn(side.chosen(np.flatnonzero(~changed)), view.chosen(~changed), None, self._settings)[0]
        # A single changed point is six pixels wide with its outline of one and a half: less is easily missed.
        pixels[nearest_points(view.chosen(changed), 9, *size) >= 0] = 255
        nearest = nearest_points(view.chosen(changed), 6, *size)
        colors = np.zeros((len(self._changes.items), 3), np.uint8)
        for label, item in enumerate(self._changes):
            colors[label] = color_bytes(KIND_COLORS[item.kind])
        pixels[nearest >= 0, :3] = colors[side.labels[changed][nearest[nearest >= 0]]]
        return pixels

    def _side(self, cloud: PointCloud, labels: Int[np.ndarray, " n"], after: bool) -> _Side:
        move = self._changes.registration.apply if after else np.asarray
        points = move(cloud.points)
        sensors = np.empty((0, 3)) if cloud.views is None else move(cloud.views.poses[:, :3, 3])
        colors = cloud.colors
        # Colours that hardly differ tell nothing; heights do.
        if colors is None or np.ptp(luminance(colors)) <= 0.05:
            # Without a background of its own, the picture must stand out from dark and light pages.
            greys = 96 + 100 * stretched(points @ self._camera.up)
            colors = np.repeat(np.rint(greys).astype(np.uint8)[:, None], 3, axis=1)
        # By their first coordinate: the surroundings of a change are then looked for in a part of the points.
        return _Side(points, colors, labels, sensors).chosen(np.argsort(points[:, 0], kind="stable"))


def write_thumbnails(folder: Path, clouds: Pair[PointCloud], changes: Changes) -> None:
    """Write `before.webp` and `after.webp`, see `Pictures.overview`. The same input gives the same bytes.

    Args:
        folder: where to; it must be there.
        clouds: as they were given to the detection; the after cloud is shown registered.
        changes: what was found.

    Raises:
        InputError: clouds that are not those of the changes, or a folder that cannot be written.
    """
    shown = presented(changes, *clouds)
    for side, content in zip(NAMES, Pictures(shown.clouds, shown.changes, THUMBNAIL).overview(), strict=True):
        with atomic_write(folder / f"{side}.webp") as file:
            file.write(content)


def data_uri(picture: bytes) -> str:
    """Return a picture as the address of an image of a page."""
    return "data:image/webp;base64," + base64.b64encode(picture).decode("ascii")


def _around(side: _Side, target: _Target) -> _Side:
    """Choose the points in a sphere about the change, twice as large as the picture."""
    reach = 2 * SURROUNDINGS * target.radius
    ends = np.searchsorted(side.points[:, 0], [target.centre[0] - reach, target.centre[0] + reach])
    within = np.arange(*ends)
    return side.chosen(within[np.linalg.norm(side.points[within] - target.centre, axis=1) <= reach])


def _chosen_camera(near: Pair[_Side], target: _Target, first: PlotCamera) -> PlotCamera:
    """Choose the direction in which the least stands in front of the change, and that its sensor looked from."""
    cameras = _cameras(first)
    directions = np.stack([camera.towards_eye for camera in cameras])
    cost = 0.05 * (1 - directions @ first.towards_eye)
    for side in near:
        own = int(target.among(side).sum())
        blocked = np.array([_blocked(side, target, camera).sum() for camera in cameras])
        cost += blocked / np.maximum(blocked + own, 1)
        if own and len(side.sensors):
            sensors = side.sensors - target.centre
            lengths = np.maximum(np.linalg.norm(sensors, axis=1, keepdims=True), 1e-12)
            # The side of a thing that was never scanned is half as bad as one that is hidden.
            cost += (1 - (directions @ (sensors / lengths).T).max(axis=1)) / 4
    return cameras[int(np.argmin(cost))]


def _cameras(first: PlotCamera) -> Sequence[PlotCamera]:
    """Place twelve cameras around the vertical, 32 degrees above the horizon, beginning where the page looks from."""
    across, _, _ = first.axes
    level = np.cross(across, first.up)
    height = np.radians(32.0)
    turns = 2 * np.pi * np.arange(12) / 12
    directions = (np.cos(turn) * level + np.sin(turn) * across for turn in turns)
    return [PlotCamera(np.cos(height) * own + np.sin(height) * first.up, first.up) for own in directions]


def _blocked(side: _Side, target: _Target, camera: PlotCamera) -> Bool[np.ndarray, " n"]:
    """Find the points between eye and change: in line with it, nearer than its box, and higher than the ground."""
    towards, up = camera.towards_eye, camera.up
    front, base = (target.points @ towards).max(), (target.points @ up).min()
    relative = side.points - target.centre
    depth = relative @ towards
    aside = np.linalg.norm(relative - depth[:, None] * towards, axis=1)
    # What lies lower is the floor, which goes on in front of the change.
    standing = relative @ up > base + 0.15 * target.radius
    return np.asarray(standing & (depth > front) & (aside < 1.3 * target.radius) & ~target.among(side))


def _visible(side: _Side, target: _Target, camera: PlotCamera, distance: float, settings: PictureSettings) -> _Side:
    """Choose the points in the picture that do not stand in front of the change, not too many of them."""
    seen = _seen(side.points, camera, target.centre, distance, settings)
    inside = (np.abs(seen.column / settings.width - 0.5) < 0.52) & (np.abs(seen.row / settings.height - 0.5) < 0.52)
    inside &= (seen.depth > 0) & ~_blocked(side, target, camera)
    shown = side.chosen(np.flatnonzero(inside))
    return shown.thinned(target.among(shown), settings.max_points)


def _seen(
    points: Float[np.ndarray, "n 3"],
    camera: PlotCamera,
    centre: Float[np.ndarray, "3"],
    distance: float,
    settings: PictureSettings,
) -> Projected:
    """Project points into the picture."""
    across, upwards, towards_eye = ((points - centre) @ camera.axes.T).T
    depth = distance - towards_eye
    # Points behind the eye are not drawn; the limit keeps the scale of those beside it finite.
    scale = settings.height / (2 * HALF_HEIGHT) / np.maximum(depth, 0.02 * distance)
    return Projected(settings.width / 2 + scale * across, settings.height / 2 - scale * upwards, depth)


def _drawn(
    side: _Side, view: Projected, target: _Target | None, settings: PictureSettings
) -> tuple[UInt8[np.ndarray, "h w 4"], Bool[np.ndarray, "h w"]]:
    """Draw the points, shaded by steps of depth, those of the target tinted; return where these are seen, too."""
    nearest = _nearest(view, settings)
    covered = nearest >= 0
    points = nearest[covered]
    depth = np.full(nearest.shape, np.inf, np.float32)
    depth[covered] = view.depth[points]
    # A step of a tenth of an octave is as dark as any: else every outline would be black.
    shade = np.exp(-14 * depth_steps(depth, largest=0.1)[covered])
    colors, changed = side.colors[points].astype(np.float32), np.zeros_like(covered)
    if target is not None:
        changed[covered] = tinted = target.among(side)[points]
        kind = np.array(color_bytes(KIND_COLORS[target.kind]), np.float32)
        colors[tinted] += 0.6 * (kind - colors[tinted])
    pixels = np.zeros((*nearest.shape, 4), np.uint8)
    pixels[covered, :3] = np.rint(colors * shade[:, None]).astype(np.uint8)
    pixels[covered, 3] = 255
    return pixels, changed


def _nearest(view: Projected, settings: PictureSettings) -> Int[np.ndarray, "h w"]:
    """Find the point at each pixel, -1 where there is none; narrow gaps are closed."""
    inside = (view.column >= 0) & (view.column < settings.width) & (view.row >= 0) & (view.row < settings.height)
    nearest = nearest_points(view, settings.square(int(inside.sum())), settings.height, settings.width)
    covered = nearest >= 0
    if covered.any():
        rows, columns = distance_transform_edt(~covered, return_distances=False, return_indices=True)
        nearest = np.where(enclosed(covered, GAP), nearest[rows, columns], nearest)
    return nearest


def _outline(changed: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Draw a line around where changed points are seen, but for gaps of up to 12 pixels between them."""
    square, closed = np.ones((3, 3)), 6
    margin = closed + OUTLINE
    padded = binary_fill_holes(binary_closing(np.pad(changed, margin), square, closed))
    lines = binary_dilation(padded, square, OUTLINE) & ~padded
    return np.asarray(lines[margin:-margin, margin:-margin])


def _webp(pixels: UInt8[np.ndarray, "h w 4"]) -> bytes:
    # With its plugin, so that Pillow does not import those of all other formats.
    from PIL import Image
    from PIL import WebPImagePlugin as WebPImagePlugin

    content = io.BytesIO()
    # Below 50 the shading turns into blocks; more effort takes twice as long for a few percent.
    Image.fromarray(pixels, "RGBA").save(content, "WEBP", quality=60, method=2)
    return content.getvalue()
