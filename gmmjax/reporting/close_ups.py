"""Close-ups: small pictures of a change before and after, from one camera, made without WebGL."""

import base64
import dataclasses
import io
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.ndimage import binary_closing, binary_dilation, binary_fill_holes, distance_transform_edt

from gmmjax.changes import Changes, Kind
from gmmjax.clouds import PointCloud
from gmmjax.geometry import evenly_chosen
from gmmjax.pair import Pair, each
from gmmjax.reporting.camera import HALF_HEIGHT, PlotCamera, initial_camera
from gmmjax.reporting.framing import stretched
from gmmjax.reporting.palette import KIND_COLORS, color_bytes, luminance
from gmmjax.reporting.splats import Projected, depth_steps, enclosed, nearest_points, square_edge


@dataclasses.dataclass(frozen=True)
class CloseUpSettings:
    """How close-ups are drawn.

    Attributes:
        width: pixels; pages show the pictures at half their size, so that they are sharp on fine screens.
        height: pixels.
        most: changes, the most probable ones, that have close-ups; the page grows by some 30 kB for each.
        most_points: of each cloud that are drawn in a picture, at most; with fewer, surfaces have holes, with more,
            drawing takes longer.
        judged_points: of each cloud that the direction of the camera is chosen by; with far fewer, a post in front of
            the change is overlooked.
        surroundings: half the width of what is shown of the surroundings, in radii of the change. 1: the
            change fills the picture, and nobody sees where it is.
        reach: radius around the change within which points are drawn, in half widths of the picture. 1: the
            surroundings end within the picture.
        elevation: of the camera above the horizon, degrees. 0: what stands around hides the change.
        azimuths: directions around the vertical that the camera is chosen from. 1: a wall may be in the way.
        unscanned: how much a direction counts that the sensor did not look from, where its place is known, compared
            with one that is blocked. 0: the camera may look at the side of a thing that was never scanned.
        ground: height above the lowest point of the change, in radii of the change, up to which nothing is cut
            away in front of it. 0: the floor ends at the change.
        opening: radius about the line of sight within which what stands in front of the change is cut away, in the same
            unit. 0: a wall hides it.
        covered: area of the squares of all points, in pictures: the fewer points there are, the larger are their
            squares. With less, surfaces have holes; with more, small things lose their outline.
        largest_square: pixels, edge of the square of a point, at most; ten points are still seen to be points.
        gap: pixels, half the width of the gaps of surfaces that are closed. 0 leaves them, and surfaces near the eye
            are speckled.
        shading: how much darker pixels are the further they lie behind their neighbours: powers of e for an octave of
            depth. At 0 only colours tell objects apart.
        largest_step: octaves of depth beyond which a step shades no more; without it, every outline is black.
        tint: share of the colour of the kind in that of a changed point. 0: only the outline tells which they are.
        outline: pixels, width of the line around the changed points; 0: none.
        closed: pixels, half the width of the gaps between changed points that the line does not follow. 0: a sparse
            change is a heap of small circles.
        darkest: brightness of the lowest points of a cloud without colours, 0 to 255; the picture has no background of
            its own, and must stand out from dark and light pages.
        lightest: brightness of the highest points, likewise.
        least_contrast: of brightness, 0 to 1; colours that differ by less tell nothing, and heights are shown instead.
        quality: of the WebP encoding, 0 to 100; below 50 the shading turns into blocks, above 90 files double.
        effort: of the WebP encoder, 0 to 6; above 2 pictures take twice as long to be a few percent smaller.
    """

    width: int = 360
    height: int = 270
    most: int = 48
    most_points: int = 80_000
    judged_points: int = 4_000
    surroundings: float = 2.0
    reach: float = 4.0
    elevation: float = 32.0
    azimuths: int = 12
    unscanned: float = 0.5
    ground: float = 0.15
    opening: float = 1.3
    covered: float = 2.5
    largest_square: int = 9
    gap: int = 10
    shading: float = 14.0
    largest_step: float = 0.1
    tint: float = 0.6
    outline: int = 2
    closed: int = 6
    darkest: int = 96
    lightest: int = 196
    least_contrast: float = 0.05
    quality: int = 60
    effort: int = 2

    def square(self, points: int) -> int:
        """Pixels, edge of the squares of a number of points."""
        return square_edge(points, self.covered * self.width * self.height, self.largest_square)


class _Side(NamedTuple):
    """Points of one cloud in the frame of the before cloud.

    Attributes:
        points: coordinates.
        colors: of the scan, or greys by height.
        labels: per point -1 or the index of its change.
        sensors: where the sensor stood; no rows where that is not known.
    """

    points: Float[np.ndarray, "n 3"]
    colors: UInt8[np.ndarray, "n 3"]
    labels: Int[np.ndarray, " n"]
    sensors: Float[np.ndarray, "v 3"]

    def chosen(self, rows: Int[np.ndarray, " m"]) -> "_Side":
        """Some of the points."""
        return _Side(self.points[rows], self.colors[rows], self.labels[rows], self.sensors)


class _Target(NamedTuple):
    """What a picture is of.

    Attributes:
        labels: of the changes that are tinted.
        kind: whose colour they have.
        centre: in the middle of the picture.
        points: some of their points, relative to the centre; those that lie far out are left out.
        radius: of the sphere about the centre that holds these points.
    """

    labels: tuple[int, ...]
    kind: Kind
    centre: Float[np.ndarray, "3"]
    points: Float[np.ndarray, "n 3"]
    radius: float

    @classmethod
    def of(cls, changes: Changes, labels: tuple[int, ...], points: Float[np.ndarray, "n 3"]) -> "_Target":
        """The changes with these labels together.

        Args:
            changes: what was found.
            labels: of the object.
            points: of it, in both clouds; where there are none, as of a record made by hand, its box is shown.
        """
        if not len(points):
            points = np.concatenate([changes[label].box.corners() for label in labels])
        lower, upper = np.quantile(points, [0.02, 0.98], axis=0)
        centre = (lower + upper) / 2
        distances = np.linalg.norm(points - centre, axis=1)
        inner = distances <= np.quantile(distances, 0.98)
        # A change of a single point has no size, and still has surroundings.
        least = 1e-9 * float(np.abs(centre).max()) + float(np.finfo(np.float32).tiny)
        return cls(
            labels, changes[labels[0]].kind, centre, (points - centre)[inner], max(float(distances[inner].max()), least)
        )


class CloseUps:
    """The pictures of a pair of clouds.

    Attributes:
        directions: of the pictures made so far, by the label of each change: the unit vector towards the eye.
    """

    def __init__(
        self, clouds: Pair[PointCloud], changes: Changes, settings: CloseUpSettings = CloseUpSettings()
    ) -> None:
        """Prepares the clouds.

        Args:
            clouds: that the changes were found in, the after cloud as given.
            changes: what was found.
            settings: how they are drawn.
        """
        self._changes, self._settings = changes, settings
        self.directions: dict[int, np.ndarray] = {}
        self._camera = initial_camera(changes.registration.apply(clouds.after.points))
        labels = Pair(changes.labels_before, changes.labels_after)
        # By their first coordinate: the surroundings of a change are then looked for in a part of the points.
        self._sides = each(self._side, clouds, labels, Pair(False, True))

    def of(self, labels: tuple[int, ...]) -> Pair[str]:
        """The pictures of one object before and after, as data URIs.

        Args:
            labels: of its change, or of both changes of a moved object.
        """
        own = [side.points[np.isin(side.labels, labels)] for side in self._sides]
        own = [points[_thinned(len(points), self._settings.judged_points)] for points in own]
        target = _Target.of(self._changes, labels, np.concatenate(own))
        near = self._sides.map(lambda side: _around(side, target, self._settings))
        few = near.map(lambda side: _with_all_changed(side, target, self._settings.judged_points))
        camera = _chosen_camera(few, target, self._camera, self._settings)
        self.directions |= dict.fromkeys(labels, camera.towards_eye)
        distance = self._settings.surroundings * target.radius / HALF_HEIGHT
        near = near.map(lambda side: _visible(side, target, camera, distance, self._settings))
        views = near.map(lambda side: _seen(side.points, camera, target.centre, distance, self._settings))
        drawn = each(lambda side, view: _Drawing.of(side, view, target, self._settings), near, views)
        # Where the change was or will be is outlined in either picture.
        outline = _outline(drawn.before.changed | drawn.after.changed, self._settings)
        return drawn.map(lambda one: _data_uri(one.pixels, outline, target.kind, self._settings))

    def overview(self) -> Pair[str]:
        """Pictures of both clouds as a whole, with every change in the colour of its kind, as data URIs."""
        settings = self._settings
        few = self._sides.map(lambda side: side.chosen(_thinned(len(side.points), settings.most_points)))
        origin = few.before.points[0]
        corners = np.concatenate([np.empty((0, 3)), *(change.box.corners() for change in self._changes)]) - origin
        framed = np.concatenate([side.points[evenly_chosen(len(side.points), 2_000)] - origin for side in few])
        half_width = HALF_HEIGHT * settings.width / settings.height
        centre, distance = self._camera.framed(np.concatenate([framed, corners]), corners, half_width)
        return few.map(lambda side: self._overview(side, origin + centre, distance))

    def _overview(self, side: _Side, centre: Float[np.ndarray, "3"], distance: float) -> str:
        settings = self._settings
        view = _seen(side.points, self._camera, centre, distance, settings)
        pixels = _Drawing.of(side, view, None, settings).pixels
        for kind, color in KIND_COLORS.items():
            own = np.isin(side.labels, [label for label, item in enumerate(self._changes) if item.kind == kind])
            over = nearest_points(view.chosen(own), settings.outline + 2, settings.height, settings.width) >= 0
            pixels[over] = *color_bytes(color), 255
        return _encoded(pixels, settings)

    def _side(self, cloud: PointCloud, labels: Int[np.ndarray, " n"], after: bool) -> _Side:
        move = self._changes.registration.apply if after else np.asarray
        points = move(cloud.points)
        sensors = np.empty((0, 3)) if cloud.views is None else move(cloud.views.poses[:, :3, 3])
        colors = cloud.colors
        if colors is None or np.ptp(luminance(colors)) <= self._settings.least_contrast:
            heights = stretched(points @ self._camera.up)
            greys = self._settings.darkest + heights * (self._settings.lightest - self._settings.darkest)
            colors = np.repeat(np.rint(greys).astype(np.uint8)[:, None], 3, axis=1)
        order = np.argsort(points[:, 0], kind="stable")
        return _Side(points, colors, labels, sensors).chosen(order)


def _around(side: _Side, target: _Target, settings: CloseUpSettings) -> _Side:
    """The points in a sphere about the change."""
    reach = settings.reach * settings.surroundings * target.radius
    ends = np.searchsorted(side.points[:, 0], [target.centre[0] - reach, target.centre[0] + reach])
    within = np.arange(*ends)
    return side.chosen(within[np.linalg.norm(side.points[within] - target.centre, axis=1) <= reach])


def _with_all_changed(side: _Side, target: _Target, most: int) -> _Side:
    """At most this number of the points of the target, and of the others."""
    changed = np.isin(side.labels, target.labels)
    parts = np.flatnonzero(changed), np.flatnonzero(~changed)
    return side.chosen(np.concatenate([part[_thinned(len(part), most)] for part in parts]))


def _thinned(count: int, most: int) -> Int[np.ndarray, " m"]:
    """At most this number of rows, the same ones each time; not every n-th, which makes patterns of grids."""
    if count <= most:
        return np.arange(count)
    places = np.arange(most) + np.random.default_rng(0).random(most)
    return (places * (count / most)).astype(int)


def _chosen_camera(near: Pair[_Side], target: _Target, first: PlotCamera, settings: CloseUpSettings) -> PlotCamera:
    """The direction in which the least stands in front of the change, and that its sensor looked from."""
    cameras = _cameras(first, settings)
    directions = np.stack([camera.towards_eye for camera in cameras])
    cost = 0.05 * (1 - directions @ first.towards_eye)
    for side in near:
        cost += [_blocked_share(side, target, camera, settings) for camera in cameras]
        if np.isin(side.labels, target.labels).any() and len(side.sensors):
            sensors = side.sensors - target.centre
            lengths = np.maximum(np.linalg.norm(sensors, axis=1, keepdims=True), 1e-12)
            cost += settings.unscanned * (1 - (directions @ (sensors / lengths).T).max(axis=1)) / 2
    return cameras[int(np.argmin(cost))]


def _cameras(first: PlotCamera, settings: CloseUpSettings) -> Sequence[PlotCamera]:
    """Around the vertical, in equal steps, the first as near as can be to where the page looks from at first."""
    across, _, _ = first.axes
    level = np.cross(across, first.up)
    height = np.radians(settings.elevation)
    turns = 2 * np.pi * np.arange(settings.azimuths) / settings.azimuths
    return [
        PlotCamera(
            np.cos(height) * (np.cos(turn) * level + np.sin(turn) * across) + np.sin(height) * first.up, first.up
        )
        for turn in turns
    ]


def _blocked_share(side: _Side, target: _Target, camera: PlotCamera, settings: CloseUpSettings) -> float:
    """How much of what is seen in the direction of the change stands in front of it."""
    blocked = int(_blocked(side, target, camera, settings).sum())
    return blocked / max(blocked + int(np.isin(side.labels, target.labels).sum()), 1)


def _blocked(side: _Side, target: _Target, camera: PlotCamera, settings: CloseUpSettings) -> Bool[np.ndarray, " n"]:
    """The points between the eye and the change: in line with it, nearer than its box, and higher than the ground."""
    towards, up = camera.towards_eye, camera.up
    front, base = (target.points @ towards).max(), (target.points @ up).min()
    ground = base + settings.ground * target.radius
    relative = side.points - target.centre
    depth = relative @ towards
    aside = np.linalg.norm(relative - depth[:, None] * towards, axis=1)
    standing = (depth > front) & (aside < settings.opening * target.radius) & (relative @ up > ground)
    return np.asarray(standing & ~np.isin(side.labels, target.labels))


def _visible(side: _Side, target: _Target, camera: PlotCamera, distance: float, settings: CloseUpSettings) -> _Side:
    """The points in the picture that do not stand in front of the change, not too many of them."""
    seen = _seen(side.points, camera, target.centre, distance, settings)
    inside = (np.abs(seen.column / settings.width - 0.5) < 0.52) & (np.abs(seen.row / settings.height - 0.5) < 0.52)
    inside &= (seen.depth > 0) & ~_blocked(side, target, camera, settings)
    return _with_all_changed(side.chosen(np.flatnonzero(inside)), target, settings.most_points)


def _seen(
    points: Float[np.ndarray, "n 3"],
    camera: PlotCamera,
    centre: Float[np.ndarray, "3"],
    distance: float,
    settings: CloseUpSettings,
) -> Projected:
    """Where points are in the picture."""
    across, upwards, towards_eye = ((points - centre) @ camera.axes.T).T
    depth = distance - towards_eye
    # Points behind the eye are not drawn; the limit keeps the scale of those beside it finite.
    scale = settings.height / (2 * HALF_HEIGHT) / np.maximum(depth, 0.02 * distance)
    return Projected(settings.width / 2 + scale * across, settings.height / 2 - scale * upwards, depth)


class _Drawing(NamedTuple):
    """A picture without its outline.

    Attributes:
        pixels: red, green, blue and opacity.
        changed: where changed points are seen.
    """

    pixels: UInt8[np.ndarray, "h w 4"]
    changed: Bool[np.ndarray, "h w"]

    @classmethod
    def of(cls, side: _Side, view: Projected, target: _Target | None, settings: CloseUpSettings) -> "_Drawing":
        """The points, shaded by steps of depth, those of the target tinted."""
        nearest = _nearest(view, settings)
        covered = nearest >= 0
        points = nearest[covered]
        depth = np.full(nearest.shape, np.inf, np.float32)
        depth[covered] = view.depth[points]
        shade = np.exp(-settings.shading * depth_steps(depth, settings.largest_step)[covered])
        colors, changed = side.colors[points].astype(np.float32), np.zeros_like(covered)
        if target is not None:
            changed[covered] = tinted = np.isin(side.labels[points], target.labels)
            kind = np.array(color_bytes(KIND_COLORS[target.kind]), np.float32)
            colors[tinted] += settings.tint * (kind - colors[tinted])
        pixels = np.zeros((*nearest.shape, 4), np.uint8)
        pixels[covered, :3] = np.rint(colors * shade[:, None]).astype(np.uint8)
        pixels[covered, 3] = 255
        return cls(pixels, changed)


def _nearest(view: Projected, settings: CloseUpSettings) -> Int[np.ndarray, "h w"]:
    """The index of the point at each pixel, -1 where there is none; narrow gaps are closed."""
    size = settings.height, settings.width
    inside = (view.column >= 0) & (view.column < settings.width) & (view.row >= 0) & (view.row < settings.height)
    square = settings.square(int(inside.sum()))
    nearest = nearest_points(view, square, *size)
    covered = nearest >= 0
    if settings.gap and covered.any():
        rows, columns = distance_transform_edt(~covered, return_distances=False, return_indices=True)
        nearest = np.where(enclosed(covered, settings.gap), nearest[rows, columns], nearest)
    return nearest


def _outline(changed: Bool[np.ndarray, "h w"], settings: CloseUpSettings) -> Bool[np.ndarray, "h w"]:
    """A line around where changed points are seen, but for the gaps between them."""
    if not settings.outline:
        return np.zeros_like(changed)
    square = np.ones((3, 3))
    margin = settings.closed + settings.outline
    padded = binary_fill_holes(binary_closing(np.pad(changed, margin), square, settings.closed))
    lines = binary_dilation(padded, square, settings.outline) & ~padded
    return np.asarray(lines[margin:-margin, margin:-margin])


def _data_uri(
    pixels: UInt8[np.ndarray, "h w 4"], outline: Bool[np.ndarray, "h w"], kind: Kind, settings: CloseUpSettings
) -> str:
    drawn = pixels.copy()
    drawn[outline] = *color_bytes(KIND_COLORS[kind]), 255
    return _encoded(drawn, settings)


def _encoded(pixels: UInt8[np.ndarray, "h w 4"], settings: CloseUpSettings) -> str:
    # With its plugin, so that Pillow does not import those of all other formats.
    from PIL import Image
    from PIL import WebPImagePlugin as WebPImagePlugin

    content = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(content, "WEBP", quality=settings.quality, method=settings.effort)
    return "data:image/webp;base64," + base64.b64encode(content.getvalue()).decode("ascii")
