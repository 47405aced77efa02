"""Which volume a change has, and what is measured of it: that between two surfaces, or that of a closed object."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.spatial import cKDTree

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Change, GainOrLoss, VolumeMethod
from gmmjax.changes.objects.change_surface import ChangeSurface
from gmmjax.changes.objects.hull_volume import hull_measures
from gmmjax.changes.objects.placed_change import MeasuredPart, PlacedChange, placed_change
from gmmjax.changes.objects.surface_volume import volumes_of, window_reach
from gmmjax.changes.objects.volume_settings import VolumeSettings
from gmmjax.changes.signed_distance import OuterSide
from gmmjax.geometry import evenly_chosen, within_box
from gmmjax.pair import Pair, each


class _Quantity(NamedTuple):
    """What a `Change` records of its volume."""

    area: float | None = None
    volume: float | None = None
    volume_error: float | None = None
    volume_registration_error: float | None = None
    volume_method: VolumeMethod | None = None
    gain_or_loss: GainOrLoss | None = None
    volume_counted_in: int | None = None
    opposite_volume: float | None = None
    opposite_volume_error: float | None = None
    opposite_volume_registration_error: float | None = None


def with_volumes(
    items: Sequence[Change],
    parts: Sequence[MeasuredPart],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    distance: Pair[Float[np.ndarray, " _"]],
    sensors: Pair[Float64[np.ndarray, "_ 3"] | None],
    outer_side: OuterSide,
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
        outer_side: what tells from which side surfaces were seen.
        registration_error: of the pair, standard deviation.
        settings: how they are measured.
    """
    places = []
    for index, (item, part) in enumerate(zip(items, parts, strict=True)):
        own, other = (sensors.after, sensors.before) if part.after else (sensors.before, sensors.after)
        # Without poses the outer side of a surface is a guess; that an object left its place is none.
        guessed = own is None and item.kind == "moved"
        median = None if guessed else _median_distance(index, labels, distance)
        places.append(placed_change(item, part, pair, median, other, outer_side, settings))
    counted_in = _counted_in(places, settings)
    found = []
    for index, item in enumerate(items):
        if counted_in[index] is not None:
            quantity = _Quantity(volume_counted_in=counted_in[index])
        else:
            whole = item.kind == "moved"
            quantity = _quantity(index, places, counted_in, pair, registration_error, settings, whole=whole)
            # Whether a closed object came or left, and where one moved, is known without the free side.
            closed = quantity.volume_method == "hull" or item.kind == "moved"
            if not closed and not _side_is_known(places[index], pair, outer_side):
                quantity = quantity._replace(gain_or_loss=None)
        found.append(dataclasses.replace(item, **quantity._asdict()))
    return tuple(found)


def _median_distance(
    index: int, labels: Pair[Int[np.ndarray, " _"]], distance: Pair[Float[np.ndarray, " _"]]
) -> float | None:
    """The signed distance of the points of a change, in the unit of the clouds; None where there is none."""
    own = np.concatenate([*each(lambda values, label: values[label == index], distance, labels)])
    return float(np.nanmedian(own)) if np.isfinite(own).any() else None


def _counted_in(places: Sequence[PlacedChange], settings: VolumeSettings) -> list[int | None]:
    """For each change the change of the other scan that is the other surface of the same volume, if there is one.

    The old and the new surface of what was eroded may both be found changed. The larger one has the volume; a patch of
    the ground that a block hides, below which nothing is seen, has none beside that of the block.
    """
    areas = [len(place.surface) * place.spacing**2 for place in places]
    order = sorted(range(len(places)), key=lambda index: (not places[index].on_surface, -areas[index], index))
    found: list[int | None] = [None] * len(places)
    for rank, index in enumerate(order):
        for larger in order[:rank]:
            if found[larger] is None and _is_other_surface(places[index], places[larger], settings):
                found[index] = larger
                break
    return found


def _is_other_surface(own: PlacedChange, other: PlacedChange, settings: VolumeSettings) -> bool:
    """Whether a change is the other surface of a change of the other scan."""
    if own.part.after == other.part.after or not other.on_surface:
        return False
    across = np.linalg.svd(other.outward[None])[2][1:]
    points, others = own.surface.points + (own.mean - other.mean), other.surface.points
    distance, nearest = cKDTree(others @ across.T).query(points @ across.T, distance_upper_bound=2 * other.spacing)
    near = np.isfinite(distance)
    # In front of it or behind it by less than it is wide.
    depth = np.abs((points[near] - others[nearest[near]]) @ other.outward)
    width = float(np.ptp(others @ across.T, axis=0).max())
    if (depth <= width).sum() < settings.same * len(points):
        return False
    # Of a surface that was raised in one part and lowered in another the two scans may show either more of.
    same_effect = own.gained == other.gained or (own.layer and other.layer)
    # A patch that is thinner than it is far from the other surface is the ground that a block hides now.
    patch = bool(np.ptp(points @ other.outward) <= np.median(depth))
    return patch or (own.on_surface and same_effect)


def _side_is_known(place: PlacedChange, pair: AlignedPair, outer_side: OuterSide) -> bool:
    """Whether it is known on which side of the surface that a change is measured from the free space is.

    Height tells it of what is more level than upright, unless most of its scan goes on beneath: that may be a ceiling.
    """
    if outer_side == "sensor":
        return True
    if outer_side == "unknown" or abs(place.outward[2]) < np.sqrt(0.5):
        return False
    own, scan = place.part.points + place.mean, pair.points.after if place.part.after else pair.points.before
    lower, upper = own.min(axis=0), own.max(axis=0)
    beneath = within_box(scan, np.append(lower[:2], -np.inf), np.append(upper[:2], lower[2] - place.spacing))
    return len(beneath) < len(own) / 2


def _quantity(
    index: int,
    places: Sequence[PlacedChange],
    counted_in: Sequence[int | None],
    pair: AlignedPair,
    registration_error: float,
    settings: VolumeSettings,
    *,
    whole: bool,
) -> _Quantity:
    place = places[index]
    if not place.on_surface:
        return _hull_quantity(place, registration_error, settings)
    own = [other for other in range(len(places)) if other == index or counted_in[other] == index]
    change = _change_surface(index, own, places, pair, settings)
    volumes = volumes_of(change, registration_error, settings.surfaces, whole=whole)
    if not volumes:
        return _hull_quantity(place, registration_error, settings)
    larger = volumes[0]
    measured = _Quantity(
        sum(volume.area for volume in volumes),
        abs(larger.gain),
        larger.error,
        larger.registration_error,
        "surface",
        _effect(larger.gain >= 0),
    )
    if len(volumes) == 1:
        return measured
    opposite = volumes[1]
    return measured._replace(
        opposite_volume=abs(opposite.gain),
        opposite_volume_error=opposite.error,
        opposite_volume_registration_error=opposite.registration_error,
    )


def _effect(gained: bool) -> GainOrLoss:
    return "gain" if gained else "loss"


def _change_surface(
    index: int, own: Sequence[int], places: Sequence[PlacedChange], pair: AlignedPair, settings: VolumeSettings
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


def _hull_quantity(place: PlacedChange, registration_error: float, settings: VolumeSettings) -> _Quantity:
    """The volume of an object of which nobody saw what it stands on."""
    points, plane, up = place.part.points, place.part.plane, place.outward
    feet = np.empty((0, 3))
    if plane is not None:
        up = plane.up
        feet = points - plane.above(points + place.mean)[:, None] * up
    spacing = place.spacing * np.sqrt(len(place.surface) / len(points))
    volume = hull_measures(points, feet, up, spacing, registration_error, settings.hulls, hangs=place.hangs)
    if volume is None:
        return _Quantity()
    return _Quantity(*volume, "hull", _effect(place.gained))
