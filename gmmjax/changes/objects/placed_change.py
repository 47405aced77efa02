"""Where a change lies above the surface of the other scan, and whether there is more or less now."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.spatial import ConvexHull, QhullError, cKDTree

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Change
from gmmjax.changes.objects.height_above import HeightAbove
from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.changes.objects.surface_volume import window_reach
from gmmjax.changes.objects.volume_settings import VolumeSettings
from gmmjax.changes.signed_distance import CorePoints, OuterSide
from gmmjax.geometry import MEAN_NEIGHBOURS, LocalSurface, evenly_chosen, nearest_neighbours, within_box


class MeasuredPart(NamedTuple):
    """The points of a change that it is measured by.

    Attributes:
        points: without outliers, relative to the mean of the change.
        after: whether they are of the after scan.
        plane: that it stands on, where there is one.
    """

    points: Float64[np.ndarray, "n 3"]
    after: bool
    plane: SupportPlane | None


class PlacedChange(NamedTuple):
    """A change above the surface of the other scan.

    Attributes:
        mean: of the change, which all coordinates are relative to.
        part: of the change.
        surface: some of its points with their normals.
        reference: the surface of the other scan about it.
        outward: unit normal of the reference below it, to the outer side.
        on_surface: whether the other scan saw that surface below it.
        gained: whether there is more now.
        layer: whether it lies as that surface does, which was displaced: the sign of its distance says what was gained.
        hangs: whether it is off that surface, which its own scan shows behind it: lamps, signs.
        highest: coordinate along the normal above which everything is something else, such as a shelf above the change.
    """

    mean: Float64[np.ndarray, " 3"]
    part: MeasuredPart
    surface: LocalSurface
    reference: LocalSurface
    outward: Float64[np.ndarray, " 3"]
    on_surface: bool
    gained: bool
    layer: bool = False
    hangs: bool = False
    highest: float = np.inf

    @property
    def spacing(self) -> float:
        """Of the points of the surface."""
        return float(np.median(self.surface.spacing(np.arange(len(self.surface)))))


def placed_change(
    item: Change,
    part: MeasuredPart,
    pair: AlignedPair,
    distance: float | None,
    sensors: Float64[np.ndarray, "p 3"] | None,
    outer_side: OuterSide,
    settings: VolumeSettings,
) -> PlacedChange:
    """A change above the surface of the other scan, which is cut out about it.

    Args:
        item: the change.
        part: the points that it is measured by.
        pair: both clouds, registered.
        distance: signed, of its points; None where there is none, or its sign is not to be trusted.
        sensors: where those of the other survey stood; None: not known.
        outer_side: what tells from which side surfaces were seen.
        settings: how changes are measured.
    """
    own, other = pair.surfaces.swapped if part.after else pair.surfaces
    reach = window_reach(part.points, settings.surfaces)
    lower, upper = part.points.min(axis=0) - reach, part.points.max(axis=0) + reach
    rows = within_box(other.points, lower + item.mean, upper + item.mean)
    if not len(rows):
        rows = np.array([int(other.nearest(item.mean[None])[0])])
    surface = LocalSurface.of(part.points[evenly_chosen(len(part.points), settings.surfaces.sample)])
    around = other.points[rows] - item.mean
    reference = LocalSurface.of(around)
    if sensors is not None:
        revealed = _not_seen_through(item) and _behind(surface, reference, sensors - item.mean)
    else:
        revealed = outer_side == "up" and _under_all(part.points + item.mean, other.points)
    place = _on_nearest(item.mean, part, surface, reference, distance, revealed, settings)
    if place.on_surface and _hangs_clear(place, own, settings):
        return place._replace(on_surface=False, hangs=True)
    if place.on_surface or part.plane is None:
        return place
    return _on_plane(place, part.plane.up, around, settings)


def _hangs_clear(place: PlacedChange, own: LocalSurface, settings: VolumeSettings) -> bool:
    """Whether a change is off the surface of the other scan, and its own scan shows that surface behind it.

    What lies on a surface hides it. Between a lamp and the ceiling nothing was gained or lost.

    Args:
        place: on that surface.
        own: the scan of the change.
        settings: how far off it is, and which part of it has that surface behind it.
    """
    points, reference, across = place.surface.points, place.reference, np.linalg.svd(place.outward[None])[2][1:]
    heights = _heights(place.surface, reference, place.outward, settings)
    near = settings.below * float(np.median(reference.spacing(reference.nearest(points))))
    lowest, highest = np.quantile(np.abs(heights), [settings.resting, 1 - settings.resting])
    # What stands on a surface is seen from near it upwards.
    if lowest <= max(near, highest - lowest):
        return False
    try:
        # Joggled, so that a row of points has one, too.
        outline = ConvexHull(points @ across.T, qhull_options="QJ").equations
    except (QhullError, ValueError):
        return False
    behind = points - heights[:, None] * place.outward
    distance, nearest = nearest_neighbours(own.tree, behind + place.mean, MEAN_NEIGHBOURS)
    shown = (own.points[nearest] - place.mean) @ across.T
    # What is seen of it beside the change is not behind it.
    inside = (shown @ outline[:, :2].T + outline[:, 2]).max(axis=2) < 0
    return bool(np.mean((inside & (distance <= near)).any(axis=1)) >= settings.on_surface)


def _on_nearest(
    mean: Float64[np.ndarray, " 3"],
    part: MeasuredPart,
    surface: LocalSurface,
    reference: LocalSurface,
    distance: float | None,
    revealed: bool,
    settings: VolumeSettings,
) -> PlacedChange:
    """A change on the part of the other scan's surface that is nearest to it.

    Args:
        mean: of the change.
        part: of it, relative to its mean.
        surface: some of its points with their normals.
        reference: the surface of the other scan about it.
        distance: signed, between both surfaces there; None where there is none, or its sign is not to be trusted.
        revealed: whether what the other scan shows in front of it went, or came, rather than the change itself.
        settings: when it is on a surface.
    """
    nearest = reference.nearest(surface.points)
    below = reference.normals[nearest]
    outward, heights, consistent = _best_plane(surface, reference, nearest, settings)
    on_surface = bool(np.mean(consistent) >= settings.on_surface)
    if on_surface:
        reference = _of_one_level(reference, reference.points[nearest[consistent]], part.points, outward, settings)
        heights = _heights(surface, reference, outward, settings)
    # Towards the after surface where that lies on the outer side; else what appeared was added, unless only what hid it
    # was taken away, as from before the wall of a pit.
    aligned = np.mean(np.abs((surface.normals * below).sum(axis=1)) >= settings.aligned) >= settings.on_surface
    layer = bool(on_surface and aligned and distance)
    gained = distance > 0 if layer and distance else part.after != (on_surface and revealed)
    if (float(np.median(heights)) > 0) != (gained == part.after):
        outward = -outward
    return PlacedChange(mean, part, surface, reference, outward, on_surface, gained, layer)


class _OnPlane(NamedTuple):
    """A change above a surface, along one normal.

    Attributes:
        outward: the normal.
        heights: of the points of the change above the surface.
        below: whether the other scan has that surface below each of them, at the height of what is nearest.
    """

    outward: Float64[np.ndarray, " 3"]
    heights: Float64[np.ndarray, " n"]
    below: Bool[np.ndarray, " n"]


def _best_plane(
    surface: LocalSurface, reference: LocalSurface, nearest: Int[np.ndarray, " n"], settings: VolumeSettings
) -> _OnPlane:
    """A change along the normal of the surface next to it, or along its own where more of the surroundings face there.

    Next to what was dug away there may be little but the walls of the pit.

    Args:
        surface: some of the points of the change with their normals.
        reference: the surface of the other scan about it.
        nearest: its points next to those of the change.
        settings: when the change is on it.
    """

    def along(outward: Float64[np.ndarray, " 3"]) -> _OnPlane:
        heights = _heights(surface, reference, outward, settings)
        # Beside walls and racks the nearest points are theirs, and not at the height of what is below there.
        to_nearest = (surface.points - reference.points[nearest]) @ outward
        consistent = np.abs(heights - to_nearest) <= settings.nearest * np.abs(heights) + reference.spacing(nearest)
        return _OnPlane(outward, heights, consistent & _observed_below(surface, reference, outward, settings))

    below, own = (np.linalg.eigh(side.T @ side)[1][:, -1] for side in (reference.normals[nearest], surface.normals))
    if float(((reference.normals @ own) ** 2).mean()) > float(((reference.normals @ below) ** 2).mean()):
        found = along(own)
        if np.mean(found.below) >= settings.on_surface:
            return found
    return along(below)


def _heights(
    surface: LocalSurface, reference: LocalSurface, outward: Float64[np.ndarray, " 3"], settings: VolumeSettings
) -> Float64[np.ndarray, " n"]:
    """Of the points of a change above the surface of the other scan."""
    above = HeightAbove(reference, outward, settings.surfaces.heights.planes, settings.surfaces.heights.steepest)
    return above.of(surface.points)


def _not_seen_through(item: Change) -> bool:
    """Whether the other survey did not reach more of a change than it saw through; False without poses."""
    contributions = item.explanation.contributions if item.explanation is not None else ()
    facts = {own.fact: own.value for own in contributions}
    return facts.get("unreached", 0.0) > facts.get("seen_through", 0.0)


def _behind(surface: LocalSurface, reference: LocalSurface, sensors: Float64[np.ndarray, "p 3"]) -> bool:
    """Whether a change lies behind the nearest surface of the other scan, as that survey's sensors see it."""
    nearest = CorePoints.of(reference, sensors, reference.nearest(surface.points))
    return bool(np.median(((surface.points - nearest.points) * nearest.normals).sum(axis=1)) < 0)


def _under_all(points: Float64[np.ndarray, "n 3"], scan: Float64[np.ndarray, "m 3"]) -> bool:
    """Whether all that a scan shows in the column of some points is above most of them, as above the walls of a pit."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    column = within_box(scan, np.append(lower[:2], -np.inf), np.append(upper[:2], np.inf))
    return bool(len(column) and np.mean(scan[column, 2] > np.median(points[:, 2])) > 0.9)


def _of_one_level(
    reference: LocalSurface,
    below: Float64[np.ndarray, "n 3"],
    points: Float64[np.ndarray, "m 3"],
    outward: Float64[np.ndarray, " 3"],
    settings: VolumeSettings,
) -> LocalSurface:
    """A surface without what is far above and below the change, such as the shelf above what lies on a floor.

    Args:
        reference: of the other scan, about the change.
        below: its points next to the change.
        points: of the change, in the same unit and frame.
        outward: unit normal of the surface below it.
        settings: how far above and below it is another level, and how steep a surface may be.
    """
    heights = np.concatenate([below, points]) @ outward
    across = np.linalg.svd(outward[None])[2][1:]
    beside = cKDTree(points @ across.T).query(reference.points @ across.T)[0]
    slope = np.tan(np.arccos(settings.surfaces.heights.steepest))
    margin = settings.surfaces.heights.beyond * np.ptp(heights) + slope * beside
    others = reference.points @ outward
    kept = (others >= heights.min() - margin) & (others <= heights.max() + margin)
    return reference if kept.all() else LocalSurface.of(reference.points[kept])


def _on_plane(
    place: PlacedChange, up: Float64[np.ndarray, " 3"], around: Float64[np.ndarray, "n 3"], settings: VolumeSettings
) -> PlacedChange:
    """The place above the plane that the change stands on; as it is where the other scan did not see that plane.

    Args:
        place: on no surface by what is nearest.
        up: unit normal of the plane.
        around: points of the other scan about the change.
        settings: when it is on a surface.
    """
    own, others = place.part.points @ up, around @ up
    # Between walls and racks most of what the other scan has nearby is not below it.
    lower = around[others <= (own.min() + own.max()) / 2]
    if not len(lower):
        return place
    reference = LocalSurface.of(lower)
    if np.mean(_observed_below(place.surface, reference, up, settings)) < settings.on_surface:
        return place
    return place._replace(reference=reference, outward=up, on_surface=True, highest=float(own.max()))


def _observed_below(
    surface: LocalSurface, reference: LocalSurface, outward: Float64[np.ndarray, " 3"], settings: VolumeSettings
) -> Bool[np.ndarray, " n"]:
    """For each point of a change whether the other scan has a surface below or above it, along this normal."""
    across = np.linalg.svd(outward[None])[2][1:]
    beside = cKDTree(reference.points @ across.T).query(surface.points @ across.T)[0]
    return np.asarray(beside <= settings.below * reference.spacing(reference.nearest(surface.points)))
