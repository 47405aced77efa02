"""Both clouds of a report, small enough for a page: positions as an octree, all else as bytes, deflated."""

import base64
import math
import zlib
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8, UInt64

from gmmjax.changes import Changes
from gmmjax.clouds import PointCloud, intensity_field
from gmmjax.geometry import evenly_chosen
from gmmjax.pair import Pair, each
from gmmjax.reporting.camera import initial_camera
from gmmjax.reporting.framing import shown_range, stretched
from gmmjax.reporting.octree import DEEPEST, morton_codes, octree_bytes, parting_levels
from gmmjax.reporting.palette import KIND_COLORS
from gmmjax.reporting.quantities import rounded_up

# The label of unchanged points.
NO_LABEL = 0xFFFF
SIDES = ("before", "after")


# Points of one cloud in a page, at 4 bytes each: with more, a page of large scans is too large for a browser. Unchanged
# points are left out before those of changes.
MOST_POINTS = 1_000_000
# Bits of the brightness; the two differences of colour have one less. As read, 8, pages are half as large again.
COLOR_BITS = 6
# Of probabilities from 0 to 1, and of distances from minus to plus their limit: they are only seen as colours.
PROBABILITY_LEVELS, DISTANCE_LEVELS = 32, 63


class PackedScene(NamedTuple):
    """What the viewer draws.

    Attributes:
        scene: plain values for JSON: the changes, and how to read the points. Positions are relative to its `origin`.
        points: of each cloud in base64: the bytes of the octree, then one byte for each point and attribute, attribute
            by attribute, deflated.
    """

    scene: dict[str, Any]
    points: Pair[str]


class Lattice(NamedTuple):
    """The cube that the octree of both clouds divides.

    Attributes:
        lower: its lower corner.
        edge: its length, in the unit of the clouds.
        depth: of the octree: there are 2 to this power steps along the edge.
    """

    lower: Float[np.ndarray, "3"]
    edge: float
    depth: int = DEEPEST

    @property
    def step(self) -> float:
        """Between neighbours on the lattice; no point is further from its own than half of it along any axis."""
        return self.edge / 2**self.depth

    def codes(self, points: Float[np.ndarray, "n 3"]) -> UInt64[np.ndarray, " n"]:
        """Of points in the cube."""
        steps = np.floor((points - self.lower) / self.step).astype(np.int64)
        return morton_codes(np.clip(steps, 0, 2**self.depth - 1))


class _Found(NamedTuple):
    """What was found of the points of one cloud: the arrays of `Changes`."""

    labels: Int[np.ndarray, " n"]
    probability: Float[np.ndarray, " n"]
    unobserved: Bool[np.ndarray, " n"]
    distance: Float[np.ndarray, " n"] | None

    def chosen(self, order: Int[np.ndarray, " m"]) -> "_Found":
        """Of some of the points."""
        return _Found(*(None if values is None else values[order] for values in self))  # type: ignore[arg-type]


class _Side(NamedTuple):
    """One cloud, in the order of the octree.

    Attributes:
        order: the indices of the points that are packed.
        codes: of their places on the lattice, all different.
        spacing: of these points, in the unit of the clouds.
    """

    order: Int[np.ndarray, " n"]
    codes: UInt64[np.ndarray, " n"]
    spacing: float


def packed_scene(clouds: Pair[PointCloud], changes: Changes, most_points: int = MOST_POINTS) -> PackedScene:
    """The clouds and what changed, for the viewer of the report.

    The same clouds give the same bytes. A point is drawn at most half a step of `scene["quantisation"]` from where it
    is, along each axis; of the points at the same place one is kept, of a change where there is one.

    Args:
        clouds: in the frame of the before cloud.
        changes: between them.
        most_points: of each cloud.
    """
    lower, upper = shown_range(np.concatenate([cloud.points for cloud in clouds]), changes)
    # Coincident points have no extent, but float64 has steps.
    smallest = 2**DEEPEST * float(np.spacing(max(np.abs(lower).max(), np.abs(upper).max())))
    origin, edge = (lower + upper) / 2, max(float((upper - lower).max()), smallest)
    finest = Lattice(origin - edge / 2, edge)
    found = _found(changes)
    sides = each(
        lambda cloud, own: _side(cloud.points, own.labels >= 0, finest, (lower, upper), most_points), clouds, found
    )
    lattice = finest._replace(depth=_depth(min(side.spacing for side in sides), edge))
    sides = sides.map(lambda side: _coarsened(side, lattice.depth))
    limit = _distance_limit(changes)
    planes = each(
        lambda cloud, side, found: _planes(cloud, found.chosen(side.order), side.order, limit),
        clouds,
        sides,
        found,
    )
    camera = initial_camera(clouds.after.points if len(clouds.after) else clouds.before.points)
    scene = {
        "origin": origin.tolist(),
        "unit": changes.unit,
        "up": camera.up.tolist(),
        "towardsEye": camera.towards_eye.tolist(),
        "shown": {"lower": (lower - origin).tolist(), "upper": (upper - origin).tolist()},
        "quantisation": {"lower": (lattice.lower - origin).tolist(), "step": lattice.step, "depth": lattice.depth},
        "before": _side_record(clouds.before, sides.before, planes.before),
        "after": _side_record(clouds.after, sides.after, planes.after),
        "colorBits": COLOR_BITS,
        "probabilityLevels": PROBABILITY_LEVELS,
        "distanceLevels": DISTANCE_LEVELS,
        "has": {
            "scan": any(_scan_values(cloud) is not None for cloud in clouds),
            "distance": limit is not None,
            "unobserved": bool(changes.unobserved_before.any() or changes.unobserved_after.any()),
        },
        "distanceLimit": limit,
        "kindColors": dict(KIND_COLORS),
        "changes": _change_records(changes, origin),
        "rejected": [
            {
                "kind": candidate.kind,
                "reason": candidate.reason,
                "side": SIDES[candidate.kind == "appeared"],
                **_box_record(candidate, origin),
            }
            for candidate in changes.rejected
        ],
        "stations": _station_records(changes, origin),
    }
    return PackedScene(scene, each(lambda side, own: _encoded(side.codes, lattice.depth, own), sides, planes))


def _side(
    points: Float[np.ndarray, "n 3"],
    changed: Bool[np.ndarray, " n"],
    lattice: Lattice,
    shown: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    most_points: int,
) -> _Side:
    """The points in the shown box, thinned out."""
    inside = np.flatnonzero(np.all((points >= shown[0]) & (points <= shown[1]), axis=1))
    codes = lattice.codes(points[inside])
    # Among points of the same place those of changes come first.
    order = np.argsort(codes << np.uint64(1) | ~changed[inside], kind="stable")
    order, codes = inside[order], codes[order]
    levels = parting_levels(codes)
    kept = np.flatnonzero(levels <= DEEPEST)
    kept = kept[_thinned(levels[kept], changed[order[kept]], most_points)]
    order, codes = order[kept], codes[kept]
    return _Side(order, codes, _spacing(parting_levels(codes), lattice.edge))


def _thinned(levels: Int[np.ndarray, " n"], changed: Bool[np.ndarray, " n"], most: int) -> Int[np.ndarray, " m"]:
    """At most so many points: those of changes, then one for each cell of the octree, then others at random."""
    if len(levels) <= most:
        return np.arange(len(levels))
    changes = np.flatnonzero(changed)
    if len(changes) >= most:
        return changes[evenly_chosen(len(changes), most)]
    unchanged = np.flatnonzero(~changed)
    free, own = most - len(changes), levels[unchanged]
    fitting = np.flatnonzero(np.cumsum(np.bincount(own)) <= free)
    first = own <= (fitting[-1] if len(fitting) else -1)
    others = unchanged[~first]
    filling = np.random.default_rng(0).choice(others, free - int(first.sum()), replace=False)
    return np.sort(np.concatenate([changes, unchanged[first], filling]))


def _spacing(levels: Int[np.ndarray, " n"], edge: float) -> float:
    """The spacing of points on surfaces, by how many cells they occupy that are so large that most have several."""
    if not len(levels):
        return edge
    cells = np.cumsum(np.bincount(levels, minlength=DEEPEST + 1))
    level = int(np.searchsorted(4 * cells, len(levels), side="right")) - 1
    return edge / 2**level * math.sqrt(cells[level] / len(levels)) if level >= 0 else edge


def _depth(spacing: float, edge: float) -> int:
    """Depth of the octree whose steps are an eighth of the spacing: no lattice is seen among neighbouring points."""
    return int(np.clip(math.ceil(math.log2(edge / spacing)) + 3, 1, DEEPEST))


def _coarsened(side: _Side, depth: int) -> _Side:
    """The points on the lattice of this depth: of those that now share a place the first is kept."""
    codes = side.codes >> np.uint64(3 * (DEEPEST - depth))
    first = parting_levels(codes, depth) <= depth
    return side._replace(order=side.order[first], codes=codes[first])


def _distance_limit(changes: Changes) -> float | None:
    """Where the scale of the distances ends: 1, 2 or 5 times a power of ten, for its legend."""
    measured = [values for values in (changes.distance_before, changes.distance_after) if values is not None]
    distances = np.abs(np.concatenate(measured)) if measured else np.empty(0)
    distances = distances[np.isfinite(distances)]
    if not len(distances):
        return None
    # A single stray distance would make all others the colour of none.
    share = max(float(np.quantile(distances, 0.99)), float(np.finfo(np.float32).tiny))
    return rounded_up(share)


def _found(changes: Changes) -> Pair[_Found]:
    return Pair(
        _Found(changes.labels_before, changes.probability_before, changes.unobserved_before, changes.distance_before),
        _Found(changes.labels_after, changes.probability_after, changes.unobserved_after, changes.distance_after),
    )


def _planes(
    cloud: PointCloud, found: _Found, order: Int[np.ndarray, " n"], limit: float | None
) -> dict[str, UInt8[np.ndarray, " n"]]:
    """The attributes of the chosen points, a byte each."""
    labels = np.where(found.labels < 0, NO_LABEL, np.minimum(found.labels, NO_LABEL - 1)).astype(np.uint16)
    planes = {
        "labelLow": (labels & 0xFF).astype(np.uint8),
        "labelHigh": (labels >> 8).astype(np.uint8),
        "unobserved": found.unobserved.astype(np.uint8),
        "probability": np.rint(found.probability * (PROBABILITY_LEVELS - 1)).astype(np.uint8),
    }
    if found.distance is not None and limit is not None:
        planes["distance"] = _distance_bytes(found.distance / limit)
    values = _scan_values(cloud)
    if values is not None:
        planes |= _color_planes(values, order)
    return planes


def _distance_bytes(shares: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
    """From 1 for minus the limit to `DISTANCE_LEVELS` for the limit; 0 where nothing was measured."""
    numbers = 1 + (DISTANCE_LEVELS - 1) * (np.clip(np.nan_to_num(shares), -1, 1) + 1) / 2
    return np.where(np.isnan(shares), 0, np.rint(numbers)).astype(np.uint8)


def _scan_values(cloud: PointCloud) -> np.ndarray | None:
    """The cloud's own colours, else its intensity; None without them, and where all points have the same."""
    values, name = cloud.colors, intensity_field(cloud.fields)
    if values is None and name is not None:
        values = cloud.fields[name]
    # Every LAS file has an intensity, many of them 0 throughout.
    return values if values is not None and (values != values[:1]).any() else None


def _color_planes(values: np.ndarray, order: Int[np.ndarray, " n"]) -> dict[str, UInt8[np.ndarray, " n"]]:
    """Brightness and, of colours, two differences; each point's from the point before, as neighbours are alike."""
    if values.ndim == 1:
        grey = np.nan_to_num(values[order].astype(np.float64))
        brightness = np.rint(stretched(grey) * 255).astype(np.int16)
        return {"brightness": _differences(brightness >> 8 - COLOR_BITS)}
    red, green, blue = values[order].astype(np.int16).T
    return {
        "brightness": _differences((red + 2 * green + blue) // 4 >> 8 - COLOR_BITS),
        "orange": _differences((red - blue) // 2 >> 8 - COLOR_BITS),
        "green": _differences((2 * green - red - blue) // 4 >> 8 - COLOR_BITS),
    }


def _differences(values: Int[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
    """From each value's predecessor, modulo 256."""
    return np.diff(values, prepend=values.dtype.type(0)).astype(np.uint8)


def _encoded(codes: UInt64[np.ndarray, " n"], depth: int, planes: dict[str, UInt8[np.ndarray, " n"]]) -> str:
    parts = [octree_bytes(codes, depth), *planes.values()] if len(codes) else []
    return base64.b64encode(zlib.compress(b"".join(part.tobytes() for part in parts))).decode("ascii")


def _side_record(cloud: PointCloud, side: _Side, planes: dict[str, np.ndarray]) -> dict[str, Any]:
    return {"count": len(cloud), "drawn": len(side.order), "spacing": side.spacing, "attributes": list(planes)}


def _change_records(changes: Changes, origin: Float[np.ndarray, "3"]) -> list[dict[str, Any]]:
    of_before = set(np.unique(changes.labels_before).tolist())
    return [
        {
            "label": label,
            "side": SIDES[label not in of_before],
            "kind": change.kind,
            "probability": change.probability,
            **_box_record(change, origin),
            "mean": (change.mean - origin).tolist(),
            "covariance": change.covariance.tolist(),
            "partner": change.partner,
            "transform": None if change.transform is None else _about(change.transform, origin).tolist(),
        }
        for label, change in enumerate(changes)
    ]


def _station_records(changes: Changes, origin: Float[np.ndarray, "3"]) -> list[dict[str, Any]]:
    """Where the sensors stood, as far as that was recognised, in the frame of the before cloud."""
    records = []
    for side, positions in zip(SIDES, changes.recognised_stations(), strict=True):
        own = changes.registration.apply(positions) if side == "after" else positions
        for number, position in enumerate(own - origin, 1):
            records.append({"side": side, "number": number, "position": position.tolist()})
    return records


def _box_record(item: Any, origin: Float[np.ndarray, "3"]) -> dict[str, Any]:
    return {**item.box.to_dict(), "centre": (item.box.centre - origin).tolist()}


def _about(transform: Float[np.ndarray, "4 4"], origin: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """The same rigid motion, of coordinates relative to the origin."""
    moved = transform.copy()
    moved[:3, 3] += transform[:3, :3] @ origin - origin
    return moved
