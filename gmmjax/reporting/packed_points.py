"""Both clouds of a report, small enough for a page: positions as an octree, all else as bytes, deflated."""

import base64
import math
import zlib
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8, UInt64

from gmmjax.changes import NAMES, Changes
from gmmjax.clouds import PointCloud, intensity_field
from gmmjax.geometry import evenly_chosen
from gmmjax.pair import Pair, each
from gmmjax.reporting.camera import initial_camera
from gmmjax.reporting.octree import DEEPEST, morton_codes, octree_bytes, parting_levels
from gmmjax.reporting.palette import KIND_COLORS, stretched
from gmmjax.reporting.quantities import rounded_up

# The label of unchanged points.
NO_LABEL = 0xFFFF
# Points of one cloud in a page, at 4 bytes each: with more, a page of large scans is too large for a browser. Unchanged
# points are left out before those of changes.
MAX_POINTS = 1_000_000
# Bits of the brightness; the two differences of colour have one less. As read, 8, pages are half as large again.
COLOR_BITS = 6
# Of probabilities from 0 to 1, and of distances from minus to plus their limit: they are only seen as colours.
PROBABILITY_LEVELS, DISTANCE_LEVELS = 32, 63


class PackedScene(NamedTuple):
    """Scene that the viewer draws.

    Attributes:
        scene: plain values for JSON: the changes, and how to read the points. Positions are relative to its `origin`.
        points: of each cloud in base64: the bytes of the octree, then one byte for each point and attribute, attribute
            by attribute, deflated.
    """

    scene: dict[str, Any]
    points: Pair[str]


class Lattice(NamedTuple):
    """The cube that the octree of both clouds divides: lower corner, edge, and depth, 2**depth steps along the edge."""

    lower: Float[np.ndarray, "3"]
    edge: float
    depth: int = DEEPEST

    @property
    def step(self) -> float:
        """The distance of neighbours; no point is further from its own than half of it along any axis."""
        return self.edge / 2**self.depth

    def codes(self, points: Float[np.ndarray, "n 3"]) -> UInt64[np.ndarray, " n"]:
        """Return the Morton codes of points in the cube."""
        steps = np.floor((points - self.lower) / self.step).astype(np.int64)
        return morton_codes(np.clip(steps, 0, 2**self.depth - 1))


class _Side(NamedTuple):
    """The points of one cloud that are packed, by index in the order of the octree; places, all different; spacing."""

    order: Int[np.ndarray, " n"]
    codes: UInt64[np.ndarray, " n"]
    spacing: float


def packed_scene(clouds: Pair[PointCloud], changes: Changes, max_points: int = MAX_POINTS) -> PackedScene:
    """Pack the clouds, in the frame of the before cloud, and what changed, for the viewer of the report.

    The same clouds give the same bytes. A point is drawn at most half a step of `scene["quantisation"]` from where it
    is, along each axis; of the points at the same place one is kept, of a change where there is one.
    """
    lower, upper = shown_range(np.concatenate([cloud.points for cloud in clouds]), changes)
    # Coincident points have no extent, but float64 has steps.
    smallest = 2**DEEPEST * float(np.spacing(max(np.abs(lower).max(), np.abs(upper).max())))
    origin, edge = (lower + upper) / 2, max(float((upper - lower).max()), smallest)
    finest = Lattice(origin - edge / 2, edge)
    labels = Pair(changes.labels_before, changes.labels_after)
    sides = each(lambda cloud, own: _side(cloud.points, own >= 0, finest, (lower, upper), max_points), clouds, labels)
    lattice = finest._replace(depth=_depth(min(side.spacing for side in sides), edge))
    sides = sides.map(lambda side: _coarsened(side, lattice.depth))
    limit = _distance_limit(changes)
    planes = each(lambda name, cloud, side: _planes(changes, name, cloud, side.order, limit), NAMES, clouds, sides)
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
                "side": "after" if candidate.kind == "appeared" else "before",
                **_box_record(candidate, origin),
            }
            for candidate in changes.rejected
        ],
        "stations": _station_records(changes, origin),
    }
    return PackedScene(scene, each(lambda side, own: _encoded(side.codes, lattice.depth, own), sides, planes))


def shown_range(
    points: Float[np.ndarray, "n 3"], changes: Changes
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return the corners of the box that the views show: all points but strays, and the boxes of all changes."""
    # One stray point far out must not shrink the scene to a dot.
    inner = np.quantile(points, [0.001, 0.999], axis=0)
    margin = 0.5 * (inner[1] - inner[0]).max()
    lower, upper = np.maximum(points.min(axis=0), inner[0] - margin), np.minimum(points.max(axis=0), inner[1] + margin)
    corners = np.concatenate([[lower, upper], *(change.box.corners() for change in changes.items)])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    # A plane along an axis still needs some depth.
    pad = 0.03 * max(float((upper - lower).max()), float(np.finfo(np.float32).tiny))
    return lower - pad, upper + pad


def _side(
    points: Float[np.ndarray, "n 3"],
    changed: Bool[np.ndarray, " n"],
    lattice: Lattice,
    shown: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]],
    max_points: int,
) -> _Side:
    """Choose the points in the shown box, thinned out."""
    inside = np.flatnonzero(np.all((points >= shown[0]) & (points <= shown[1]), axis=1))
    codes = lattice.codes(points[inside])
    # Among points of the same place those of changes come first.
    order = np.argsort(codes << np.uint64(1) | ~changed[inside], kind="stable")
    order, codes = inside[order], codes[order]
    levels = parting_levels(codes)
    kept = np.flatnonzero(levels <= DEEPEST)
    kept = kept[_thinned(levels[kept], changed[order[kept]], max_points)]
    order, codes = order[kept], codes[kept]
    return _Side(order, codes, _spacing(parting_levels(codes), lattice.edge))


def _thinned(levels: Int[np.ndarray, " n"], changed: Bool[np.ndarray, " n"], most: int) -> Int[np.ndarray, " m"]:
    """Choose at most so many points: those of changes, then one for each cell of the octree, then others at random."""
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
    """Estimate the spacing of points on surfaces, by the occupied cells that are so large that most have several."""
    if not len(levels):
        return edge
    cells = np.cumsum(np.bincount(levels, minlength=DEEPEST + 1))
    level = int(np.searchsorted(4 * cells, len(levels), side="right")) - 1
    return edge / 2**level * math.sqrt(cells[level] / len(levels)) if level >= 0 else edge


def _depth(spacing: float, edge: float) -> int:
    """Return the depth of the octree whose steps are an eighth of the spacing: no lattice is seen among neighbours."""
    return int(np.clip(math.ceil(math.log2(edge / spacing)) + 3, 1, DEEPEST))


def _coarsened(side: _Side, depth: int) -> _Side:
    """Move the points to the lattice of this depth: of those that now share a place the first is kept."""
    codes = side.codes >> np.uint64(3 * (DEEPEST - depth))
    first = parting_levels(codes, depth) <= depth
    return side._replace(order=side.order[first], codes=codes[first])


def _distance_limit(changes: Changes) -> float | None:
    """Return where the scale of the distances ends: 1, 2 or 5 times a power of ten, for its legend."""
    measured = [values for values in (changes.distance_before, changes.distance_after) if values is not None]
    distances = np.abs(np.concatenate(measured)) if measured else np.empty(0)
    distances = distances[np.isfinite(distances)]
    if not len(distances):
        return None
    # A single stray distance would make all others the colour of none.
    share = max(float(np.quantile(distances, 0.99)), float(np.finfo(np.float32).tiny))
    return rounded_up(share)


def _planes(
    changes: Changes, name: str, cloud: PointCloud, order: Int[np.ndarray, " n"], limit: float | None
) -> dict[str, UInt8[np.ndarray, " n"]]:
    """Encode the attributes of the chosen points of the cloud of this name, a byte each."""
    labels = getattr(changes, f"labels_{name}")[order]
    labels = np.where(labels < 0, NO_LABEL, np.minimum(labels, NO_LABEL - 1)).astype(np.uint16)
    probability = getattr(changes, f"probability_{name}")[order]
    planes = {
        "labelLow": (labels & 0xFF).astype(np.uint8),
        "labelHigh": (labels >> 8).astype(np.uint8),
        "unobserved": getattr(changes, f"unobserved_{name}")[order].astype(np.uint8),
        "probability": np.rint(probability * (PROBABILITY_LEVELS - 1)).astype(np.uint8),
    }
    distance, values = getattr(changes, f"distance_{name}"), _scan_values(cloud)
    if distance is not None and limit is not None:
        planes["distance"] = _distance_bytes(distance[order] / limit)
    return planes if values is None else planes | _color_planes(values, order)


def _distance_bytes(shares: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
    """Map minus the limit to 1, and the limit to `DISTANCE_LEVELS`; 0 where nothing was measured."""
    numbers = 1 + (DISTANCE_LEVELS - 1) * (np.clip(np.nan_to_num(shares), -1, 1) + 1) / 2
    return np.where(np.isnan(shares), 0, np.rint(numbers)).astype(np.uint8)


def _scan_values(cloud: PointCloud) -> np.ndarray | None:
    """Return the cloud's own colours, else its intensity; None without them, and where all points have the same."""
    values, name = cloud.colors, intensity_field(cloud.fields)
    if values is None and name is not None:
        values = cloud.fields[name]
    # Every LAS file has an intensity, many of them 0 throughout.
    return values if values is not None and (values != values[:1]).any() else None


def _color_planes(values: np.ndarray, order: Int[np.ndarray, " n"]) -> dict[str, UInt8[np.ndarray, " n"]]:
    """Encode brightness and, of colours, two differences; each from the point before, as neighbours are alike."""
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
    """Subtract each value's predecessor, modulo 256."""
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
            "side": "before" if label in of_before else "after",
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
    """List where the sensors stood, as far as that was recognised, in the frame of the before cloud."""
    records = []
    for side, positions in zip(NAMES, changes.recognised_stations(), strict=True):
        own = changes.registration.apply(positions) if side == "after" else positions
        for number, position in enumerate(own - origin, 1):
            records.append({"side": side, "number": number, "position": position.tolist()})
    return records


def _box_record(item: Any, origin: Float[np.ndarray, "3"]) -> dict[str, Any]:
    return {**item.box.to_dict(), "centre": (item.box.centre - origin).tolist()}


def _about(transform: Float[np.ndarray, "4 4"], origin: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """Return the same rigid motion, of coordinates relative to the origin."""
    moved = transform.copy()
    moved[:3, 3] += transform[:3, :3] @ origin - origin
    return moved
