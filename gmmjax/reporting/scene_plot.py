"""The three 3-D views of a report as data for plotly.js: before, after, changes."""

import base64
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gmmjax.changes import Change, Changes
from gmmjax.clouds import PointCloud
from gmmjax.reporting.camera import PlotCamera, initial_camera
from gmmjax.reporting.framing import shown_range, stretched
from gmmjax.reporting.palette import KIND_COLORS, luminance

MOST_UNCHANGED = 30_000
MOST_CHANGED = 15_000
# Dark to light: unchanged points stay in the background of the colours of the kinds.
GREYS = [[0, "#7f868f"], [1, "#dfe2e6"]]
# The edges of a box between its corners, whose numbers differ in one bit.
EDGES = tuple((corner, corner | 1 << axis) for corner in range(8) for axis in range(3) if not corner >> axis & 1)

Trace = dict[str, Any]


class _Side(NamedTuple):
    """One cloud, reduced to the points that are drawn.

    Attributes:
        name: "before" or "after".
        points: coordinates relative to the origin of the views.
        labels: per point -1 or the index of its change.
        probability: of being changed, per point.
        shade: brightness of the unchanged points, in their order, 0 to 1.
    """

    name: str
    points: Float[np.ndarray, "n 3"]
    labels: Int[np.ndarray, " n"]
    probability: Float[np.ndarray, " n"]
    shade: Float[np.ndarray, " m"]


def scene_views(before: PointCloud, after: PointCloud, changes: Changes) -> dict[str, Any]:
    """Data for the report's script: the traces of each view and the layout that they share.

    Coordinates are float32 relative to one origin, so that survey coordinates keep their digits. At most
    `MOST_UNCHANGED` unchanged and `MOST_CHANGED` changed points of a cloud are drawn, always the same ones.
    """
    lower, upper = shown_range(np.concatenate([before.points, after.points]), changes)
    origin = (lower + upper) / 2
    camera = initial_camera(after.points)
    sides = (
        _side("before", before, changes.labels_before, changes.probability_before, origin, camera),
        _side("after", after, changes.labels_after, changes.probability_after, origin, camera),
    )
    traces = {side.name: [_unchanged(side, 1), *_changed(side, changes)] for side in sides}
    for side in sides:
        present = set(side.labels[side.labels >= 0].tolist())
        traces[side.name] += _boxes({label: changes.items[label] for label in sorted(present)}, origin, camera)
    traces["changes"] = [_unchanged(side, 2) for side in sides]
    traces["changes"] += [trace for side in sides for trace in _changed(side, changes)]
    traces["changes"] += _boxes(dict(enumerate(changes.items)), origin, camera)
    ranges = np.stack([lower - origin, upper - origin], axis=1).tolist()
    return {
        "views": traces,
        "ranges": dict(zip("xyz", ranges, strict=True)),
        "camera": camera.to_plotly(_in_plotly_unit(np.concatenate([side.points for side in sides]), upper - lower)),
        "dragmode": "turntable" if camera.up[2] == 1 else "orbit",
    }


def _in_plotly_unit(points: Float[np.ndarray, "n 3"], extent: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
    """Plotly's cameras are in units in which the shown box, true to scale, has the volume 1."""
    scaled: Float[np.ndarray, "n 3"] = points / np.exp(np.log(extent).mean())
    return scaled


def drawn_points(labels: Int[np.ndarray, " n"]) -> int:
    """How many points of a cloud with these labels its view draws."""
    changed = int((labels >= 0).sum())
    return min(len(labels) - changed, MOST_UNCHANGED) + min(changed, MOST_CHANGED)


def _side(
    name: str,
    cloud: PointCloud,
    labels: Int[np.ndarray, " n"],
    probability: Float[np.ndarray, " n"],
    origin: Float[np.ndarray, "3"],
    camera: PlotCamera,
) -> _Side:
    unchanged, changed = np.flatnonzero(labels < 0), np.flatnonzero(labels >= 0)
    kept = np.concatenate([_sample(unchanged, MOST_UNCHANGED), _sample(changed, MOST_CHANGED)])
    points = cloud.points[kept] - origin
    grey = labels[kept] < 0
    brightness = np.zeros(int(grey.sum())) if cloud.colors is None else luminance(cloud.colors[kept][grey])
    # Without colours that tell anything, darker in front, so that the cloud has depth.
    tells = len(brightness) and np.ptp(brightness) > 0.05
    shade = stretched(brightness if tells else -points[grey] @ camera.towards_eye)
    return _Side(name, points, labels[kept], probability[kept], shade)


def _sample(indices: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " m"]:
    """At most this number of them, in order. At random, because every n-th point of a scan makes a pattern."""
    if len(indices) <= most:
        return indices
    return np.sort(np.random.default_rng(0).choice(indices, most, replace=False))


def _unchanged(side: _Side, every: int) -> Trace:
    """The unchanged points; every n-th where several clouds share a view."""
    chosen = np.flatnonzero(side.labels < 0)[::every]
    marker = {
        "size": _marker_size(len(side.points), 2.6),
        "color": _encoded(np.rint(255 * side.shade[::every]).astype(np.uint8)),
        "colorscale": GREYS,
        "cmin": 0,
        "cmax": 255,
        "opacity": 1,
        "line": {"width": 0},
    }
    return {"type": "scatter3d", "mode": "markers", "hoverinfo": "skip", "marker": marker, **_xyz(side.points[chosen])}


def _changed(side: _Side, changes: Changes) -> list[Trace]:
    """One trace for each change that has points in this cloud."""
    traces = []
    for label, change in enumerate(changes.items):
        chosen = np.flatnonzero(side.labels == label)
        if not len(chosen):
            continue
        color = KIND_COLORS[change.kind]
        traces.append(
            {
                "type": "scatter3d",
                "mode": "markers",
                "marker": {"size": _marker_size(len(side.points), 3.4), "color": color, "line": {"width": 0}},
                "hovertemplate": f"<b>{label} {change.kind}</b><br>probability %{{customdata:.0%}}<extra></extra>",
                "hoverlabel": {"bgcolor": color, "font": {"color": "#ffffff"}},
                "customdata": _encoded(side.probability[chosen].astype(np.float32)),
                **_xyz(side.points[chosen]),
            }
        )
    return traces


def _boxes(items: dict[int, Change], origin: Float[np.ndarray, "3"], camera: PlotCamera) -> list[Trace]:
    """A wireframe for each change, and their numbers."""
    traces: list[Trace] = []
    for change in items.values():
        corners = change.box.corners() - origin
        gap = np.full(3, np.nan)
        lines = np.concatenate([[corners[start], corners[end], gap] for start, end in EDGES])
        line = {"color": KIND_COLORS[change.kind], "width": 4}
        traces.append({"type": "scatter3d", "mode": "lines", "hoverinfo": "skip", "line": line, **_xyz(lines)})
    return traces + ([_numbers(items, origin, camera)] if items else [])


def _numbers(items: dict[int, Change], origin: Float[np.ndarray, "3"], camera: PlotCamera) -> Trace:
    """The changes' numbers, each above its box."""
    tops = [change.box.centre + camera.up * _height(change, camera) for change in items.values()]
    return {
        "type": "scatter3d",
        "mode": "text",
        "hoverinfo": "skip",
        "text": [f"<b>{label}</b>" for label in items],
        "textfont": {"size": 17, "color": [KIND_COLORS[change.kind] for change in items.values()]},
        "textposition": "top center",
        **_xyz(np.array(tops) - origin),
    }


def _height(change: Change, camera: PlotCamera) -> float:
    """From the centre of the change's box to its top, as the camera has up."""
    return float(((change.box.corners() - change.box.centre) @ camera.up).max())


def _marker_size(points: int, largest: float) -> float:
    """Smaller where there are many."""
    return round(largest * float(np.clip((4000 / max(points, 1)) ** 0.25, 0.6, 1)), 2)


def _xyz(points: Float[np.ndarray, "n 3"]) -> Trace:
    return {axis: _encoded(points[:, index].astype(np.float32)) for index, axis in enumerate("xyz")}


def _encoded(values: np.ndarray) -> dict[str, str]:
    """An array in plotly.js's own form: base64 of its little-endian bytes."""
    kind = {"float32": "f4", "uint8": "u1"}[values.dtype.name]
    return {"dtype": kind, "bdata": base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")}
