r"""Volumes of changes: between the surfaces of both scans, or of the convex hull of a closed object.

Between two surfaces it is that of a DEM of difference (Wheaton et al. 2010): the signed distances along the normal of
the surface (Lague et al. 2013) times the area, over its cells. With the distances $d_i$ of N cells of area a, each of
which differs by $r_i$ from its neighbours, and the registration error r, which is common to all cells,

$$V = a \sum_i d_i, \qquad \sigma^2 = a^2 \sum_i r_i^2 + (a N r)^2 .$$
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float64, Int
from scipy.spatial import ConvexHull, QhullError, cKDTree

from gmmjax.changes.align.alignment import AlignedPair
from gmmjax.changes.change import Change
from gmmjax.changes.objects.difference_cells import DifferenceCells, Grid, plane_axes, spacing_of
from gmmjax.changes.objects.support_plane import SupportPlane
from gmmjax.changes.signed_distance import CorePoints, OuterSide
from gmmjax.geometry import LocalSurface, evenly_chosen, hull_area, within_box
from gmmjax.pair import Pair, each

# Points by which directions are measured, at most: a bound on the time.
SAMPLE = 1000


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


class _Place(NamedTuple):
    """A change, the direction that it is measured in, and what is there; relative to the mean of the change.

    Attributes:
        item: the change.
        part: its points.
        sample: some of them.
        below: the points of the other scan that are nearest to these.
        outward: unit normal of the surface, to its outer side.
        spacing: of the points; 0 where they are repeated.
        stands: whether it rises from its support plane.
        directed: whether it is known that the normal points to the outer side.
    """

    item: Change
    part: MeasuredPart
    sample: Float64[np.ndarray, "s 3"]
    below: Float64[np.ndarray, "s 3"]
    outward: Float64[np.ndarray, " 3"]
    spacing: float
    stands: bool
    directed: bool


def with_volumes(
    items: Sequence[Change],
    parts: Sequence[MeasuredPart],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    sensors: Pair[Float64[np.ndarray, "_ 3"] | None],
    outer_side: OuterSide,
    registration_error: float,
) -> tuple[Change, ...]:
    """The changes with their area and their volume, None where these cannot be derived.

    Args:
        items: the changes of both clouds.
        parts: of each of them.
        labels: the change of each point of the clouds, or -1.
        pair: both clouds, registered.
        sensors: where those of each survey stood; None: not known.
        outer_side: what tells from which side surfaces were seen.
        registration_error: of the pair, standard deviation.
    """
    towards = each(lambda own, other: other if own is None else own, sensors, sensors.swapped)
    places = [_placed(item, part, pair, towards, outer_side) for item, part in zip(items, parts, strict=True)]
    leaders = _leaders(places)
    found = []
    for index, (item, leader) in enumerate(zip(items, leaders, strict=True)):
        if leader is None:
            group = [index, *(other for other, its in enumerate(leaders) if its == index)]
            measured = _measured(group, places, labels, pair, outer_side, registration_error)
        else:
            measured = {"volume_counted_in": leader}
        found.append(dataclasses.replace(item, **measured))
    return tuple(found)


def _placed(
    item: Change,
    part: MeasuredPart,
    pair: AlignedPair,
    towards: Pair[Float64[np.ndarray, "_ 3"] | None],
    outer_side: OuterSide,
) -> _Place:
    """A change with the normal of its support plane, else of most of the surfaces about it."""
    points = part.points + item.mean
    sample = points[evenly_chosen(len(points), SAMPLE)]
    other = pair.surfaces.before if part.after else pair.surfaces.after
    spacing, reach = spacing_of(points), np.ptp(points, axis=0).max() / 2
    lower, upper = points.min(axis=0) - reach, points.max(axis=0) + reach
    normals = np.concatenate([*each(lambda own, sides: _normals(own, sides, lower, upper), pair.surfaces, towards)])
    outward, rises = np.linalg.eigh(normals.T @ normals)[1][:, -1], False
    if part.plane is not None:
        outward, rises = part.plane.up, bool(np.median(part.plane.above(sample)) > 2 * spacing)
    inward = bool((normals @ outward).sum() < 0) and not (rises and outer_side == "unknown")
    below = other.points[other.nearest(sample)] - item.mean
    outward = -outward if inward else outward
    directed = outer_side == "sensor" or (outer_side == "up" and bool(abs(outward[2]) >= np.sqrt(0.5)))
    return _Place(item, part, sample - item.mean, below, outward, spacing, rises and not inward, directed)


def _normals(
    surface: LocalSurface,
    towards: Float64[np.ndarray, "p 3"] | None,
    lower: Float64[np.ndarray, " 3"],
    upper: Float64[np.ndarray, " 3"],
) -> Float64[np.ndarray, "n 3"]:
    """Normals of a surface in a box, to the side that it was seen from, upwards where that is not known."""
    rows = within_box(surface.points, lower, upper)
    rows = rows[evenly_chosen(len(rows), SAMPLE)]
    if towards is not None:
        return CorePoints.of(surface, towards, rows).normals
    normals = surface.normals[rows]
    return np.where(normals[:, 2:] < 0, -normals, normals)


def _leaders(places: Sequence[_Place]) -> list[int | None]:
    """For each change the one of the other scan that is the other surface of the same volume, if there is one.

    Of what was eroded the old and the new surface may both be found, and of a block also the ground that it hides. The
    larger one has the volume; what moved has its own.
    """
    areas = [len(place.part.points) * place.spacing**2 for place in places]
    order = sorted(range(len(places)), key=lambda index: (places[index].item.kind != "moved", -areas[index], index))
    found: list[int | None] = [None] * len(places)
    for rank, index in enumerate(order):
        larger = (one for one in order[:rank] if found[one] is None and _overlap(places[index], places[one]))
        found[index] = None if places[index].item.kind == "moved" else next(larger, None)
    return found


def _overlap(own: _Place, other: _Place) -> bool:
    """True where half of a change is in front of or behind one of the other scan, by less than that is wide."""
    if own.part.after == other.part.after:
        return False
    across = plane_axes(other.outward)
    points, plan = own.sample + (own.item.mean - other.item.mean), other.sample @ across.T
    near = 2 * max(own.spacing, spacing_of(other.sample))
    apart, nearest = cKDTree(plan).query(points @ across.T, distance_upper_bound=near)
    beside = np.isfinite(apart)
    depth = np.abs((points[beside] - other.sample[nearest[beside]]) @ other.outward)
    return bool((depth <= np.ptp(plan, axis=0).max()).sum() >= len(points) / 2)


def _measured(
    group: Sequence[int],
    places: Sequence[_Place],
    labels: Pair[Int[np.ndarray, " _"]],
    pair: AlignedPair,
    outer_side: OuterSide,
    registration_error: float,
) -> dict[str, Any]:
    """The fields of a `Change` for the volume of the first of some changes, which are one."""
    place = places[group[0]]
    moved, partner = place.item.kind == "moved", place.item.partner
    displaced = partner is not None and _overlap(place, places[partner])
    cells = None if displaced else _cells(group, places, labels, pair)
    if cells is None or cells.closed:
        return _hull(place) if place.stands or displaced or (cells is not None and cells.behind > 0.5) else {}
    volume, *opposite = cells.volumes(registration_error, whole=moved)
    gained = place.part.after if moved else volume.gain >= 0
    known = moved or _side_is_known(place, pair, outer_side)
    found = {"area": cells.area, "volume_method": "surface", "gain_or_loss": _effect(gained) if known else None}
    for prefix, own in zip(("", "opposite_"), (volume, *opposite), strict=False):
        found[f"{prefix}volume"] = abs(own.gain)
        found[f"{prefix}volume_error"] = own.error
        found[f"{prefix}volume_registration_error"] = own.registration_error
    return found


def _effect(gained: bool) -> str:
    return "gain" if gained else "loss"


def _hull(place: _Place) -> dict[str, Any]:
    """The volume of a closed object: that of its convex hull, down to the plane that it stands on."""
    points, plane = place.part.points, place.part.plane
    if plane is not None:
        points = np.concatenate([points, points - plane.above(points + place.item.mean)[:, None] * plane.up])
    try:
        volume = float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return {}
    area = hull_area(points @ plane_axes(place.outward).T)
    return {"area": area, "volume": volume, "volume_method": "hull", "gain_or_loss": _effect(place.part.after)}


def _side_is_known(place: _Place, pair: AlignedPair, outer_side: OuterSide) -> bool:
    """True where it is known on which side of the surface that a change is measured from the free space is.

    Height tells it of what is more level than upright, unless most of its scan goes on beneath: that may be a ceiling.
    """
    if outer_side == "sensor" or not place.directed:
        return place.directed
    own, scan = place.part.points + place.item.mean, pair.points.after if place.part.after else pair.points.before
    lower, upper = own.min(axis=0), own.max(axis=0)
    beneath = within_box(scan, np.append(lower[:2], -np.inf), np.append(upper[:2], lower[2] - place.spacing))
    return len(beneath) < len(own) / 2


def _cells(
    group: Sequence[int], places: Sequence[_Place], labels: Pair[Int[np.ndarray, " _"]], pair: AlignedPair
) -> DifferenceCells | None:
    """The cells of some changes that are one; None where its points are all in one place or in cells of others."""
    lead = places[group[0]]
    if lead.spacing == 0:
        return None
    parts = [(places[one].part, places[one].item.mean - lead.item.mean) for one in group]
    changed = Pair(False, True).map(
        lambda after: np.concatenate([np.empty((0, 3)), *(own.points + by for own, by in parts if own.after == after)])
    )
    points = np.concatenate([*changed, lead.below])
    # Its thin edge is looked for as far as a radius from it.
    reach = (np.sqrt(len(lead.part.points) / np.pi) + 6) * lead.spacing
    heights = points @ lead.outward
    low, high = np.quantile(heights, [0.01, 0.99])
    # Sloping ground about it is at its level, a shelf above it is not.
    margin = (high - low + reach) / 2
    level = low - margin, float(heights.max()) if lead.stands else high + margin
    lower, upper = points.min(axis=0) - reach + lead.item.mean, points.max(axis=0) + reach + lead.item.mean
    rows = pair.points.map(lambda cloud: within_box(cloud, lower, upper))
    clouds = each(lambda cloud, chosen: cloud[chosen] - lead.item.mean, pair.points, rows)
    at_level = clouds.map(lambda own: (own @ lead.outward >= level[0]) & (own @ lead.outward <= level[1]))
    clouds = each(lambda own, kept: own[kept], clouds, at_level)
    label = each(lambda of, chosen, kept: of[chosen][kept], labels, rows, at_level)
    others = each(lambda own, of: own[(of >= 0) & ~np.isin(of, group)], clouds, label)
    unlabelled = each(lambda own, of: own[of < 0], clouds, label)
    grid = Grid.about(lead.sample, lead.outward, lead.spacing, points, reach)
    background = unlabelled.after if lead.part.after else unlabelled.before
    return DifferenceCells.of(
        grid, changed, clouds, np.concatenate([*others]), background, after=lead.part.after, directed=lead.directed
    )
