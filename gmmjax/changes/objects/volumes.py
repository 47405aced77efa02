"""Which volume a change has, and what is measured of it: that between two surfaces, or that of a closed object."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Change, GainOrLoss, VolumeMethod
from gmmjax.changes.objects.change_surface import ChangeSurface
from gmmjax.changes.objects.height_above import HeightAbove
from gmmjax.changes.objects.hull_volume import HullVolumeSettings, hull_measures
from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.changes.objects.surface_volume import SurfaceMap, SurfaceVolumeSettings, window_reach
from gmmjax.changes.signed_distance import CorePoints
from gmmjax.geometry import LocalSurface, evenly_chosen, within_box
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class VolumeSettings:
    """Which volume a change has.

    All values are empirical: they come from development on the scenes of `tests/benchmarks/volumes`.

    Attributes:
        on_surface: fraction of a change's points, at least, that have a surface of the other scan below them, for the
            volume to be that between both surfaces. 0: it always is; above 1: it is always that of the hull.
        aligned: cosine, at least, between the normals of a point of a change and of the surface below it, of a layer on
            that surface; of a layer the signed distance tells whether it is a gain, of an object whether it came. 0:
            it always does, and a box before a wall may be taken for a part of the wall that receded.
        below: distance along the surface, in spacings of the other scan, up to which it has a surface below a point.
            0: no change has; infinite: the surface is taken to go on below a change that nobody saw the ground of.
        nearest: difference between the height of a point above the surface below it and that above the nearest point of
            the other scan, as a fraction of the former, at most. Where most points have a larger one, what is nearest
            is a wall, a rack or a shelf, and the change is measured down to the plane that it stands on. Infinite: it
            is always measured in the direction of what is nearest.
        same: fraction of the points of a change, at least, that lie in front of or behind those of a change of the
            other scan, of which it is the other surface: both have one volume. Above 1: it is counted twice.
        most_points: points of a scan about a change, at most: a bound on the memory.
        surfaces: how the volume between two surfaces is measured.
        hulls: how that of a closed object is.
    """

    on_surface: float = 0.5
    aligned: float = 0.7
    below: float = 3.0
    nearest: float = 0.5
    same: float = 0.5
    most_points: int = 2_000_000
    surfaces: SurfaceVolumeSettings = SurfaceVolumeSettings()
    hulls: HullVolumeSettings = HullVolumeSettings()


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


class _Quantity(NamedTuple):
    """What a `Change` records of its volume."""

    area: float | None = None
    volume: float | None = None
    volume_error: float | None = None
    volume_registration_error: float | None = None
    volume_method: VolumeMethod | None = None
    gain_or_loss: GainOrLoss | None = None
    volume_counted_in: int | None = None


class _Place(NamedTuple):
    """A change above the surface of the other scan.

    Attributes:
        mean: of the change, which all coordinates are relative to.
        part: of the change.
        surface: some of its points with their normals.
        reference: the surface of the other scan about it.
        outward: unit normal of the reference below it, to the outer side.
        on_surface: whether the other scan saw that surface below it.
        gained: whether there is more now.
        highest: coordinate along the normal above which everything is something else, such as a shelf above the change.
    """

    mean: Float64[np.ndarray, " 3"]
    part: MeasuredPart
    surface: LocalSurface
    reference: LocalSurface
    outward: Float64[np.ndarray, " 3"]
    on_surface: bool
    gained: bool
    highest: float = np.inf

    @property
    def spacing(self) -> float:
        """Of the points of the surface."""
        return float(np.median(self.surface.spacing(np.arange(len(self.surface)))))


def with_volumes(
    items: Sequence[Change],
    parts: Sequence[MeasuredPart],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    distance: Pair[Float[np.ndarray, " _"]],
    sensors: Pair[Float64[np.ndarray, "_ 3"] | None],
    registration_error: float,
    settings: VolumeSettings = VolumeSettings(),
) -> tuple[Change, ...]:
    """The changes with their area and their volume.

    Args:
        items: the changes of both clouds.
        parts: of each of them.
        labels: the change of each point of the clouds, or -1.
        pair: both clouds, registered.
        distance: signed distance of each point to the other surface; NaN where there is none.
        sensors: where those of each survey stood; None: not known.
        registration_error: of the pair, standard deviation.
        settings: how they are measured.
    """
    places = []
    for index, (item, part) in enumerate(zip(items, parts, strict=True)):
        own, other = (sensors.after, sensors.before) if part.after else (sensors.before, sensors.after)
        # Without poses the outer side of a surface is a guess; that an object left its place is none.
        guessed = own is None and item.kind == "moved"
        median = None if guessed else _median_distance(index, labels, distance)
        places.append(_place(item, part, pair, median, other, settings))
    counted_in = _counted_in(places, settings)
    found = []
    for index, item in enumerate(items):
        if counted_in[index] is not None:
            quantity = _Quantity(volume_counted_in=counted_in[index])
        else:
            quantity = _quantity(index, places, counted_in, pair, registration_error, settings)
        found.append(dataclasses.replace(item, **quantity._asdict()))
    return tuple(found)


def _median_distance(
    index: int, labels: Pair[Int[np.ndarray, " _"]], distance: Pair[Float[np.ndarray, " _"]]
) -> float | None:
    """The signed distance of the points of a change, in the unit of the clouds; None where there is none."""
    own = np.concatenate([*each(lambda values, label: values[label == index], distance, labels)])
    return float(np.nanmedian(own)) if np.isfinite(own).any() else None


def _place(
    item: Change,
    part: MeasuredPart,
    pair: AlignedPair,
    distance: float | None,
    sensors: Float64[np.ndarray, "p 3"] | None,
    settings: VolumeSettings,
) -> _Place:
    """A change above the surface of the other scan, which is cut out about it.

    Args:
        item: the change.
        part: the points that it is measured by.
        pair: both clouds, registered.
        distance: signed, of its points; None where there is none, or its sign is not to be trusted.
        sensors: where those of the other survey stood; None: not known.
        settings: how changes are measured.
    """
    other = pair.surfaces.before if part.after else pair.surfaces.after
    reach = window_reach(part.points, settings.surfaces)
    lower, upper = part.points.min(axis=0) - reach, part.points.max(axis=0) + reach
    rows = within_box(other.points, lower + item.mean, upper + item.mean)
    if not len(rows):
        rows = np.array([int(other.nearest(item.mean[None])[0])])
    surface = LocalSurface.of(part.points[evenly_chosen(len(part.points), settings.surfaces.sample)])
    around = other.points[rows] - item.mean
    reference = LocalSurface.of(around)
    revealed = sensors is not None and _not_seen_through(item) and _behind(surface, reference, sensors - item.mean)
    place = _on_nearest(item.mean, part, surface, reference, distance, revealed, settings)
    if place.on_surface or part.plane is None:
        return place
    return _on_plane(place, part.plane.up, around, settings)


def _on_nearest(
    mean: Float64[np.ndarray, " 3"],
    part: MeasuredPart,
    surface: LocalSurface,
    reference: LocalSurface,
    distance: float | None,
    revealed: bool,
    settings: VolumeSettings,
) -> _Place:
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
    layer = np.mean(np.abs((surface.normals * below).sum(axis=1)) >= settings.aligned) >= settings.on_surface
    gained = distance > 0 if on_surface and layer and distance else part.after != (on_surface and revealed)
    if (float(np.median(heights)) > 0) != (gained == part.after):
        outward = -outward
    return _Place(mean, part, surface, reference, outward, on_surface, gained)


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
    place: _Place, up: Float64[np.ndarray, " 3"], around: Float64[np.ndarray, "n 3"], settings: VolumeSettings
) -> _Place:
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


def _counted_in(places: Sequence[_Place], settings: VolumeSettings) -> list[int | None]:
    """For each change the change of the other scan that is the other surface of the same volume, if there is one.

    The old and the new surface of what was eroded may both be found changed. The larger one has the volume.
    """
    areas = [len(place.surface) * place.spacing**2 for place in places]
    order = sorted(range(len(places)), key=lambda index: (-areas[index], index))
    found: list[int | None] = [None] * len(places)
    for rank, index in enumerate(order):
        for larger in order[:rank]:
            if found[larger] is None and _is_other_surface(places[index], places[larger], settings):
                found[index] = larger
                break
    return found


def _is_other_surface(own: _Place, other: _Place, settings: VolumeSettings) -> bool:
    """Whether a change is the other surface of a change of the other scan."""
    if own.part.after == other.part.after or own.gained != other.gained or not (own.on_surface and other.on_surface):
        return False
    across = np.linalg.svd(other.outward[None])[2][1:]
    points, others = own.surface.points + (own.mean - other.mean), other.surface.points
    distance, nearest = cKDTree(others @ across.T).query(points @ across.T, distance_upper_bound=2 * other.spacing)
    near = np.isfinite(distance)
    # In front of it or behind it by less than it is wide.
    depth = np.abs((points[near] - others[nearest[near]]) @ other.outward)
    width = float(np.ptp(others @ across.T, axis=0).max())
    return bool((depth <= width).sum() >= settings.same * len(points))


def _quantity(
    index: int,
    places: Sequence[_Place],
    counted_in: Sequence[int | None],
    pair: AlignedPair,
    registration_error: float,
    settings: VolumeSettings,
) -> _Quantity:
    place, found = places[index], None
    if place.on_surface:
        own = [other for other in range(len(places)) if other == index or counted_in[other] == index]
        change = _change_surface(index, own, places, pair, settings)
        found = SurfaceMap.of(change, registration_error, settings.surfaces)
    if found is None:
        return _hull_quantity(place, registration_error, settings)
    volume = found.volume(settings.surfaces)
    errors = volume.error, volume.registration_error
    return _Quantity(volume.area, abs(volume.gain), *errors, "surface", _effect(volume.gain >= 0))


def _effect(gained: bool) -> GainOrLoss:
    return "gain" if gained else "loss"


def _change_surface(
    index: int, own: Sequence[int], places: Sequence[_Place], pair: AlignedPair, settings: VolumeSettings
) -> ChangeSurface:
    """A change with those that are counted in it, and what both scans show there."""
    place = places[index]
    moved = [(places[one].part.after, places[one].part.points + (places[one].mean - place.mean)) for one in own]
    labelled = Pair(False, True).map(
        lambda after: np.concatenate([np.empty((0, 3)), *(part for side, part in moved if side == after)])
    )
    points = np.concatenate([*labelled])
    reach = window_reach(points, settings.surfaces)
    lower, upper = points.min(axis=0) - reach, points.max(axis=0) + reach
    others = [other.part.points + (other.mean - place.mean) for one, other in enumerate(places) if one not in own]
    beside = np.concatenate([np.empty((0, 3)), *others])

    def cut(cloud: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
        rows = within_box(cloud, lower + place.mean, upper + place.mean)
        own = cloud[rows[evenly_chosen(len(rows), settings.most_points)]] - place.mean
        return own[own @ place.outward <= place.highest]

    return ChangeSurface(
        labelled, pair.points.map(cut), beside[within_box(beside, lower, upper)], place.reference, place.outward
    )


def _hull_quantity(place: _Place, registration_error: float, settings: VolumeSettings) -> _Quantity:
    """The volume of an object of which nobody saw what it stands on."""
    points, plane, up = place.part.points, place.part.plane, place.outward
    feet = np.empty((0, 3))
    if plane is not None:
        up = plane.up
        feet = points - plane.above(points + place.mean)[:, None] * up
    spacing = place.spacing * np.sqrt(len(place.surface) / len(points))
    volume = hull_measures(points, feet, up, spacing, registration_error, settings.hulls)
    if volume is None:
        return _Quantity()
    return _Quantity(*volume, "hull", _effect(place.gained))
